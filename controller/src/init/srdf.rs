//! What an SRDF says: disabled pairs, the tip of a group, a named posture.

use std::collections::BTreeMap;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use crate::init::semantic::Semantic;

/// Names of postures to begin from, the likeliest first.
const HOMES: [&str; 6] = ["ready", "home", "default", "start", "up", "rest"];

/// Takes what an SRDF says.
///
/// # Errors
/// What was expected and found.
pub(super) fn parse_srdf(text: &str, semantic: &mut Semantic) -> Result<(), String> {
    let mut reader = Reader::from_str(text);
    let (mut states, mut tips) = (BTreeMap::<String, BTreeMap<String, f64>>::new(), Vec::new());
    let (mut state, mut is_srdf) = (None, false);
    loop {
        let event = reader.read_event().map_err(|error| {
            format!("expected an SRDF, at byte {}: {error}", reader.error_position())
        })?;
        let element = match &event {
            Event::Start(element) | Event::Empty(element) => element,
            Event::End(end) if end.name().as_ref() == b"group_state" => {
                state = None;
                continue;
            }
            Event::Eof => break,
            _ => continue,
        };
        match element.name().as_ref() {
            b"robot" => is_srdf = true,
            b"group_state" => state = Some(attribute(element, "name")?),
            b"joint" => {
                if let Some(name) = &state {
                    let joint = attribute(element, "name")?;
                    let value = attribute(element, "value")?;
                    // A joint of several coordinates is no joint of an arm.
                    if value.split_whitespace().count() == 1 {
                        let at = number(&value).map_err(|text| {
                            format!("<group_state> `{name}`, joint `{joint}`: {text}")
                        })?;
                        states.entry(name.clone()).or_default().insert(joint, at);
                    }
                }
            }
            b"chain" => tips.push(attribute(element, "tip_link")?),
            b"disable_collisions" => {
                semantic.ignored.push((attribute(element, "link1")?, attribute(element, "link2")?));
            }
            _ => {}
        }
    }
    if !is_srdf {
        return Err("expected an SRDF, with an element <robot>".into());
    }
    if let [tip] = &tips[..] {
        semantic.needed_links.push(("<chain>, attribute `tip_link`".into(), tip.clone()));
        semantic.tool = Some(tip.clone());
    }
    let named =
        HOMES.iter().find_map(|home| states.keys().find(|name| name.to_lowercase() == *home));
    if let Some(name) = named.cloned() {
        semantic.home = states.remove(&name).unwrap_or_default();
        semantic.home_name = name;
    }
    Ok(())
}

fn attribute(element: &BytesStart<'_>, key: &str) -> Result<String, String> {
    let name = String::from_utf8_lossy(element.name().as_ref()).into_owned();
    let found = element.try_get_attribute(key).ok().flatten();
    let value = found
        .and_then(|attribute| attribute.unescape_value().ok().map(std::borrow::Cow::into_owned));
    value.ok_or_else(|| format!("<{name}>: expected an attribute `{key}`"))
}

fn number(text: &str) -> Result<f64, String> {
    let parsed = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    parsed.ok_or_else(|| {
        format!("expected a finite number, found `{}`", tprmp_files::printable(text))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_srdf_gives_pairs_and_a_named_posture() {
        let text = r#"<robot name="r"><group name="arm"><chain base_link="b" tip_link="t"/></group>
            <group_state name="home" group="arm"><joint name="a" value="0.5"/>
            <joint name="free" value="0. 0. 1. 0. 0. 0. 1."/></group_state>
            <disable_collisions link1="x" link2="y" reason="Never"/></robot>"#;
        let mut semantic = Semantic::default();
        parse_srdf(text, &mut semantic).unwrap();
        assert_eq!(semantic.tool.as_deref(), Some("t"));
        assert_eq!(semantic.ignored, [("x".to_owned(), "y".to_owned())]);
        assert_eq!(semantic.home["a"], 0.5);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let wrong = |text: &str| parse_srdf(text, &mut Semantic::default()).unwrap_err();
        assert!(wrong("<html/>").contains("<robot>"));
        let no_link = r#"<robot><disable_collisions link1="x"/></robot>"#;
        assert!(wrong(no_link).contains("`link2`"));
        for value in ["x", "nan", "inf"] {
            let text = format!(
                r#"<robot><group_state name="home"><joint name="a" value="{value}"/></group_state></robot>"#
            );
            let error = wrong(&text);
            assert!(error.contains("`home`, joint `a`: expected a finite number"), "{error}");
        }
    }
}
