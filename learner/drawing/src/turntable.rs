//! Bodies in space that the viewer turns: triangles, and spheres around them.

use core::fmt::Write;
use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use crate::text::escape;

/// Corners are drawn on a grid that divides the longest side so often: nobody sees more, and pages stay small.
const CELLS: f64 = 400.0;
/// Of bodies of more triangles the grid is coarser.
const TRIANGLES_MAX: usize = 24_000;
/// What draws and turns.
const SCRIPT: &str = include_str!("turntable.js");

/// A part of what is drawn, with a name of its own.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Body {
    /// Its name in the list of what can be drawn alone.
    pub name: String,
    /// Its surface \[m\].
    pub triangles: Vec<[DVec3; 3]>,
    /// Centres \[m\] and radii \[m\].
    pub spheres: Vec<(DVec3, f64)>,
}

/// A canvas on which bodies are turned by dragging. It needs no other file and no network.
#[derive(Debug, Clone, PartialEq)]
pub struct Turntable {
    /// What there is to see; at most one on a page has the same.
    pub name: String,
    /// What is drawn.
    pub bodies: Vec<Body>,
    /// What it shows; may be empty.
    pub caption: String,
}

impl Turntable {
    /// The figure as a part of a page, well-formed XML.
    pub(crate) fn html(&self) -> String {
        let name = escape(&self.name).replace(' ', "-");
        let options: String = self
            .bodies
            .iter()
            .map(|body| format!("<option>{}</option>", escape(&body.name)))
            .collect();
        // Names are escaped in the list; the script gets numbers alone.
        format!(
            "<figure id=\"{name}\">\n<canvas width=\"1400\" height=\"1000\" \
             style=\"width: 100%; max-width: 1000px; touch-action: none; cursor: grab\"></canvas>\n\
             <figcaption>{caption} <select><option>all</option>{options}</select> \
             <label><input type=\"checkbox\" checked=\"checked\"/> surfaces</label> \
             <label><input type=\"checkbox\" checked=\"checked\"/> spheres</label> \
             Drag to turn, with Shift to move, wheel to zoom.</figcaption>\n</figure>\n\
             <script>\n//<![CDATA[\n(function () {{ const id = \"{name}\", bodies = {data};\n{SCRIPT}}})();\n\
             //]]>\n</script>\n",
            caption = escape(&self.caption),
            data = self.data(),
        )
    }

    /// `[{v: [corners, mm], f: [indices], s: [centres and radii, mm]}, …]`
    fn data(&self) -> String {
        let mut cell = longest_side(&self.bodies) / CELLS;
        let mut surfaces: Vec<_> =
            self.bodies.iter().map(|body| coarse(&body.triangles, cell)).collect();
        // Twice as coarse has a quarter of the triangles.
        while surfaces.iter().map(|(_, faces)| faces.len()).sum::<usize>() > TRIANGLES_MAX {
            cell *= 1.4;
            surfaces = self.bodies.iter().map(|body| coarse(&body.triangles, cell)).collect();
        }
        let mut text = String::from("[");
        for (body, (corners, faces)) in self.bodies.iter().zip(surfaces) {
            text += "{v:[";
            for v in corners {
                let v = (v * 1e4).round() / 10.0;
                let _ = write!(text, "{},{},{},", v.x, v.y, v.z);
            }
            text += "],f:[";
            for [a, b, c] in faces {
                let _ = write!(text, "{a},{b},{c},");
            }
            text += "],s:[";
            for (centre, radius) in &body.spheres {
                let [x, y, z] = (*centre * 1e3).to_array();
                let _ = write!(text, "{x:.1},{y:.1},{z:.1},{:.1},", radius * 1e3);
            }
            text += "]},\n";
        }
        text + "]"
    }
}

fn longest_side(bodies: &[Body]) -> f64 {
    let corners = bodies.iter().flat_map(|body| body.triangles.iter().flatten().copied());
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = corners.fold(none, |(low, high), corner| (low.min(corner), high.max(corner)));
    (high - low).max_element().max(1e-3)
}

/// Triangles whose corners are the first ones that lie in each cell of a grid; those without an area are left out.
fn coarse(triangles: &[[DVec3; 3]], cell: f64) -> (Vec<DVec3>, Vec<[usize; 3]>) {
    let mut corners = Vec::new();
    let mut cells: BTreeMap<[i64; 3], usize> = BTreeMap::new();
    let mut faces = Vec::new();
    let mut known = BTreeSet::new();
    for triangle in triangles {
        let face = triangle.map(|corner| {
            *cells.entry((corner / cell).round().as_i64vec3().to_array()).or_insert_with(|| {
                corners.push(corner);
                corners.len() - 1
            })
        });
        let mut sorted = face;
        sorted.sort_unstable();
        if sorted[0] != sorted[1] && sorted[1] != sorted[2] && known.insert(sorted) {
            faces.push(face);
        }
    }
    (corners, faces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Page;

    fn body(triangles: usize) -> Body {
        let on =
            |i: usize| DVec3::new((i as f64 * 0.7).sin(), (i as f64 * 1.3).cos(), i as f64 * 1e-4);
        let triangles = (0..triangles).map(|i| [on(i), on(i + 1), on(i + 2)]).collect();
        Body { name: "a < b".into(), triangles, spheres: vec![(DVec3::X, 0.25)] }
    }

    #[test]
    fn a_page_with_bodies_needs_nothing_else_and_escapes_their_names() {
        let mut page = Page::new("links");
        let caption = "x & y".into();
        page.turntable(&Turntable { name: "the arm".into(), bodies: vec![body(3)], caption });
        let html = page.html();
        for part in [
            "<figure id=\"the-arm\">",
            "<option>a &lt; b</option>",
            "x &amp; y",
            "s:[1000.0,0.0,0.0,250.0,]",
        ] {
            assert!(html.contains(part), "{html}: no {part}");
        }
        assert!(!html.contains("http") && !html.contains(" src="), "{html}");
    }

    #[test]
    fn however_many_triangles_the_page_stays_small() {
        let turntable =
            Turntable { name: "n".into(), bodies: vec![body(300_000)], caption: String::new() };
        assert!(turntable.html().len() < 2_000_000, "{}", turntable.html().len());
        let (corners, faces) = coarse(&[[DVec3::ZERO, DVec3::X, DVec3::Y]; 2], 0.1);
        assert_eq!((corners.len(), faces.len()), (3, 1));
        assert_eq!(coarse(&[[DVec3::ZERO, DVec3::X * 0.01, DVec3::Y]], 0.1).1.len(), 0);
    }
}
