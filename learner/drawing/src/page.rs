//! Pages of tables and figures, which need no other file.

use crate::colour::INK;
use crate::text::escape;
use crate::turntable::Turntable;

/// Style sheet of every page.
const STYLE: &str = "
body { font: 15px/1.5 'Helvetica Neue', Helvetica, Arial, 'Liberation Sans', sans-serif;
  background: #f1f4f6; margin: 24px auto; max-width: 1860px; padding: 0 16px; }
h2 { margin-top: 40px; } h3 { margin: 26px 0 8px; }
p, details { max-width: 100ch; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; background: white; font-size: 14px; }
td, th { border: 1px solid #d5dce2; padding: 3px 10px; text-align: left; vertical-align: top;
  font-variant-numeric: tabular-nums; }
td.number { text-align: right; white-space: nowrap; }
table:not(:has(th)) td.number { text-align: left; }
.pass { color: #1b7a3a; font-weight: 600; } .fail { color: #c2291f; font-weight: 600; }
.open { color: #8a6100; }
.pictures { display: flex; flex-wrap: wrap; gap: 20px; align-items: flex-start; margin: 20px 0; }
figure { margin: 0; padding: 8px; max-width: 100%; box-sizing: border-box; background: white; border: 1px solid #d5dce2;
  border-radius: 6px; }
figure svg { vertical-align: top; max-width: 100%; height: auto; }
figcaption { contain: inline-size; padding: 4px 14px 10px; }
";

/// A figure and what it shows.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Its name on the page, also that of its file.
    pub name: String,
    /// The SVG document.
    pub svg: String,
    /// What it shows; may be empty.
    pub caption: String,
}

/// A cell of a table. Numbers are set to the right.
#[derive(Debug, Clone)]
pub struct Cell {
    class: &'static str,
    html: String,
}

impl<T: AsRef<str>> From<T> for Cell {
    fn from(text: T) -> Self {
        let text = text.as_ref();
        let number = text.replace('−', "-").parse::<f64>().is_ok();
        Self { class: if number { "number" } else { "" }, html: escape(text) }
    }
}

impl Cell {
    /// A judgement in a word, coloured by whether it holds; `None` where that is open.
    pub fn verdict(holds: Option<bool>, word: &str) -> Self {
        Self { class: class(holds), html: escape(word) }
    }

    /// The same with more text, which is hidden until it is asked for.
    pub fn with_details(mut self, summary: &str, text: &str) -> Self {
        self.html += &details(summary, text);
        self
    }
}

/// A page that grows from top to bottom. All text that it is given is escaped.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    body: String,
}

impl Page {
    /// An empty page.
    pub fn new(title: &str) -> Self {
        Self { title: escape(title), body: String::new() }
    }

    /// The heading of a section.
    pub fn section(&mut self, title: &str) {
        self.element("h2", "", &escape(title));
    }

    /// The heading of a part of a section.
    pub fn subsection(&mut self, title: &str) {
        self.element("h3", "", &escape(title));
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.element("p", "", &escape(text));
    }

    /// A judgement, coloured by whether it holds; `None` where that is open.
    pub fn verdict(&mut self, holds: Option<bool>, text: &str) {
        self.element("p", class(holds), &escape(text));
    }

    /// A list; nothing where it is empty.
    pub fn list(&mut self, items: &[String]) {
        let items: String =
            items.iter().map(|item| format!("<li>{}</li>\n", escape(item))).collect();
        if !items.is_empty() {
            self.element("ul", "", &items);
        }
    }

    /// Text that is hidden until it is asked for.
    pub fn details(&mut self, summary: &str, text: &str) {
        self.body += &details(summary, text);
        self.body.push('\n');
    }

    /// A table, with a head unless that is empty; nothing where there are no rows.
    pub fn table(&mut self, head: &[&str], rows: impl IntoIterator<Item = Vec<Cell>>) {
        let cell = |cell: &Cell| format!("<td{}>{}</td>", attribute(cell.class), cell.html);
        let row =
            |cells: Vec<Cell>| format!("<tr>{}</tr>\n", cells.iter().map(cell).collect::<String>());
        let rows: String = rows.into_iter().map(row).collect();
        if rows.is_empty() {
            return;
        }
        let head: String = head.iter().map(|title| format!("<th>{}</th>", escape(title))).collect();
        let head = if head.is_empty() { head } else { format!("<tr>{head}</tr>\n") };
        self.element("div", "wide", &format!("<table>\n{head}{rows}</table>"));
    }

    /// Pictures side by side, as many as fit.
    pub fn pictures<'a>(&mut self, pictures: impl IntoIterator<Item = &'a Picture>) {
        let figure = |picture: &Picture| {
            let (name, svg) = (escape(&picture.name).replace(' ', "-"), &picture.svg);
            let caption = match picture.caption.as_str() {
                "" => String::new(),
                caption => format!("<figcaption>{}</figcaption>\n", escape(caption)),
            };
            format!("<figure id=\"{name}\">\n{svg}{caption}</figure>\n")
        };
        let figures: String = pictures.into_iter().map(figure).collect();
        if !figures.is_empty() {
            self.element("div", "pictures", &format!("\n{figures}"));
        }
    }

    /// Bodies that the viewer turns.
    pub fn turntable(&mut self, turntable: &Turntable) {
        self.element("div", "pictures", &format!("\n{}", turntable.html()));
    }

    /// The HTML document, which is well-formed XML too.
    pub fn html(&self) -> String {
        let Self { title, body } = self;
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
             <title>{title}</title>\n<style>{STYLE}body {{ color: {INK}; }}\n</style>\n</head>\n\
             <body>\n<h1>{title}</h1>\n{body}</body>\n</html>\n"
        )
    }

    fn element(&mut self, name: &str, class: &str, html: &str) {
        self.body += &format!("<{name}{}>{html}</{name}>\n", attribute(class));
    }
}

fn class(holds: Option<bool>) -> &'static str {
    match holds {
        Some(true) => "pass",
        Some(false) => "fail",
        None => "open",
    }
}

fn attribute(class: &str) -> String {
    if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") }
}

fn details(summary: &str, text: &str) -> String {
    format!("<details><summary>{}</summary>{}</details>", escape(summary), escape(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_holds_what_it_was_given_and_escapes_it() {
        let mut page = Page::new("a < b");
        page.verdict(Some(false), "it does not hold");
        page.list(&[]);
        page.table(&["name", "found"], [vec!["x & y".into(), "−1.5".into()]]);
        page.table(&["nothing"], []);
        let cell = Cell::verdict(None, "open").with_details("2 failures", "p; q");
        page.table(&[], [vec![cell]]);
        let (name, svg) = ("path".into(), "<svg/>\n".into());
        page.pictures([&Picture { name, svg, caption: "c > d".into() }]);
        let html = page.html();
        for part in [
            "<h1>a &lt; b</h1>",
            "<p class=\"fail\">it does not hold</p>",
            "<td>x &amp; y</td><td class=\"number\">−1.5</td>",
            "<td class=\"open\">open<details><summary>2 failures</summary>p; q</details></td>",
            "<figure id=\"path\">\n<svg/>\n<figcaption>c &gt; d</figcaption>",
        ] {
            assert!(html.contains(part), "{html}: no {part}");
        }
        assert!(!html.contains("nothing") && !html.contains("<ul>"));
    }
}
