//! From a document's elements to its links and joints: each value that a chain can need is checked,
//! with its place, before the parser sees the document, and nothing else is handed to it.

use urdf_rs::{Geometry, Robot};

use crate::document::{
    Collision, DocumentFault, Dynamics, Inertial, Joint, Limit, Link, Mimic, Owner, Shape,
};
use crate::error::{UrdfErrorKind as Kind, UrdfFault};
use crate::xml::Element;

/// What stands in an attribute.
#[derive(Clone, Copy)]
enum Value {
    Text,
    Numbers(usize),
}
use Value::{Numbers, Text};

/// Attributes of an element of a link or a joint, and whether it has to be there. All others are left out.
fn attributes(element: &str) -> &'static [(&'static str, Value, bool)] {
    match element {
        "origin" => &[
            ("xyz", Numbers(3), false),
            ("rpy", Numbers(3), false),
            ("quat_xyzw", Numbers(4), false),
        ],
        "mass" => &[("value", Numbers(1), true)],
        "inertia" => &[
            ("ixx", Numbers(1), true),
            ("ixy", Numbers(1), true),
            ("ixz", Numbers(1), true),
            ("iyy", Numbers(1), true),
            ("iyz", Numbers(1), true),
            ("izz", Numbers(1), true),
        ],
        "cylinder" | "capsule" => &[("radius", Numbers(1), true), ("length", Numbers(1), true)],
        "sphere" => &[("radius", Numbers(1), true)],
        "box" => &[("size", Numbers(3), true)],
        "mesh" => &[("filename", Text, true), ("scale", Numbers(3), false)],
        "parent" | "child" => &[("link", Text, true)],
        "axis" => &[("xyz", Numbers(3), true)],
        "limit" => &[
            ("lower", Numbers(1), false),
            ("upper", Numbers(1), false),
            ("velocity", Numbers(1), false),
            ("effort", Numbers(1), false),
        ],
        "safety_controller" => {
            &[("soft_lower_limit", Numbers(1), false), ("soft_upper_limit", Numbers(1), false)]
        }
        "mimic" => &[
            ("joint", Text, true),
            ("multiplier", Numbers(1), false),
            ("offset", Numbers(1), false),
        ],
        "dynamics" => &[("damping", Numbers(1), false), ("friction", Numbers(1), false)],
        _ => &[],
    }
}

/// Elements that an element of a link or a joint has, and whether they have to be there.
fn children(element: &str) -> &'static [(&'static str, bool)] {
    match element {
        "inertial" => &[("origin", false), ("mass", true), ("inertia", true)],
        "collision" => &[("origin", false), ("geometry", true)],
        "joint" => &[
            ("origin", false),
            ("parent", true),
            ("child", true),
            ("axis", false),
            ("limit", false),
            ("safety_controller", false),
            ("mimic", false),
            ("dynamics", false),
        ],
        _ => &[],
    }
}

const SHAPES: [&str; 5] = ["cylinder", "capsule", "sphere", "box", "mesh"];
const TYPES: [&str; 7] =
    ["revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical"];

/// Collects the faults of one link or joint.
struct Reader<'a> {
    owner: Owner,
    /// `link` or `joint`.
    element: &'static str,
    name: &'a str,
    faults: &'a mut Vec<DocumentFault>,
}

impl Reader<'_> {
    fn fault(
        &mut self,
        part: &'static str,
        at: &Element,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) {
        let owner = format!("{} `{}`", self.element, self.name);
        let kind = Kind::Part {
            place: if at.name == self.element { owner } else { format!("{owner}: <{}>", at.name) },
            expected: expected.into(),
            found: tprmp_files::shortened(&found.into()),
        };
        let fault = UrdfFault::at(at.line, kind);
        self.faults.push(DocumentFault { owner: self.owner, part, fault });
    }

    /// The element with what can be needed of it; `None` when that cannot be read.
    fn cleaned(&mut self, part: &'static str, from: &Element) -> Option<Element> {
        let before = self.faults.len();
        let mut element = Element { attributes: Vec::new(), children: Vec::new(), ..from.clone() };
        for (attribute, value, is_required) in attributes(&from.name) {
            match from.attribute(attribute) {
                Some(found) => {
                    if let Numbers(count) = value {
                        self.check_numbers(part, from, attribute, found, *count);
                    }
                    element.attributes.push(((*attribute).into(), found.into()));
                }
                None if *is_required => {
                    self.fault(part, from, format!("the attribute `{attribute}`"), "none");
                }
                None => {}
            }
        }
        if from.name == "geometry" {
            let is_shape = |child: &&Element| SHAPES.contains(&child.name.as_str());
            let shapes: Vec<_> = from.children.iter().filter(is_shape).collect();
            if let [shape] = shapes[..] {
                element.children.extend(self.cleaned(part, shape));
            } else {
                let names: Vec<_> = from.children.iter().map(|child| child.name.as_str()).collect();
                let found = if names.is_empty() { "none".into() } else { names.join(", ") };
                self.fault(part, from, format!("one shape of {}", SHAPES.join(", ")), found);
            }
        }
        for (child, is_required) in children(&from.name) {
            element.children.extend(self.only_child(part, from, child, *is_required));
        }
        (self.faults.len() == before).then_some(element)
    }

    /// The child of this name, cleaned. Two are a fault: which one counts cannot be known.
    fn only_child(
        &mut self,
        part: &'static str,
        from: &Element,
        name: &str,
        is_required: bool,
    ) -> Option<Element> {
        let mut found = from.children.iter().filter(|child| child.name == name);
        match (found.next(), found.next()) {
            (Some(first), None) => self.cleaned(part, first),
            (Some(first), Some(second)) => {
                let expected = format!("one <{name}>: which of two counts cannot be known");
                let lines = format!("a second one; the first is on line {}", first.line);
                self.fault(part, second, expected, lines);
                None
            }
            (None, _) => {
                if is_required {
                    self.fault(part, from, format!("an element <{name}>"), "none");
                }
                None
            }
        }
    }

    fn check_numbers(
        &mut self,
        part: &'static str,
        at: &Element,
        attribute: &str,
        text: &str,
        count: usize,
    ) {
        let words: Vec<_> = text.split_whitespace().collect();
        if words.len() == count && words.iter().all(|word| word.parse::<f64>().is_ok()) {
            return;
        }
        let mut expected = match count {
            1 => format!("{attribute}: a number"),
            _ => format!("{attribute}: {count} numbers with spaces between them"),
        };
        if text.contains(',') {
            expected += " and a point before decimals";
        }
        self.fault(part, at, expected, format!("`{text}`"));
    }
}

/// Links, joints, and what could not be read of them.
type Parts = (Vec<Link>, Vec<Joint>, Vec<DocumentFault>);

/// Reads the links and joints of a robot.
///
/// # Errors
/// The parser's, of a document that was found to be right; faults of values are among what is returned.
pub(crate) fn read(root: &Element) -> Result<Parts, UrdfFault> {
    let mut faults = Vec::new();
    let named = |name: &'static str| {
        let elements = root.children.iter().filter(move |child| child.name == name);
        elements.enumerate()
    };
    let links: Vec<_> = named("link").map(|(i, link)| cleaned_link(i, link, &mut faults)).collect();
    let joints: Vec<_> =
        named("joint").map(|(i, joint)| cleaned_joint(i, joint, &mut faults)).collect();
    let mut text = String::from("<robot name=\"robot\" version=\"1.1\">");
    links.iter().chain(&joints).for_each(|element| element.write(&mut text));
    text += "</robot>";
    let robot: Robot = urdf_rs::read_from_string(&text).map_err(|error| {
        let found = tprmp_files::shortened(&error.to_string());
        UrdfFault::new(Kind::NotUrdf { found, remedy: "see the description of the format" })
    })?;
    let links = links.iter().zip(robot.links).zip(named("link")).map(|((cleaned, link), raw)| {
        let has = |name: &str| raw.1.child(name).is_some();
        let has_body = has("visual") || has("collision");
        let inertial = cleaned.child("inertial").map(|_| inertial(&link.inertial));
        let collisions = link.collision.into_iter().map(collision).collect();
        Link { name: link.name, line: cleaned.line, inertial, collisions, has_body }
    });
    let links = links.collect();
    let joints = joints.iter().zip(robot.joints).zip(named("joint"));
    let joints = joints.map(|((cleaned, found), (_, raw))| joint(cleaned, raw, found));
    Ok((links, joints.collect(), faults))
}

/// The name of a link or a joint; what has none gets an empty one.
fn name(element: &Element) -> &str {
    element.attribute("name").unwrap_or("")
}

fn cleaned_link(index: usize, from: &Element, faults: &mut Vec<DocumentFault>) -> Element {
    let name = name(from);
    let mut reader = Reader { owner: Owner::Link(index), element: "link", name, faults };
    if name.trim().is_empty() {
        reader.fault("name", from, "the attribute `name`", "none");
    }
    let mut link = Element { children: Vec::new(), ..from.clone() };
    link.attributes = vec![("name".into(), name.into())];
    link.children.extend(reader.only_child("inertial", from, "inertial", false));
    for collision in from.children.iter().filter(|child| child.name == "collision") {
        link.children.extend(reader.cleaned("collision", collision));
    }
    link
}

fn cleaned_joint(index: usize, from: &Element, faults: &mut Vec<DocumentFault>) -> Element {
    let name = name(from);
    let mut reader = Reader { owner: Owner::Joint(index), element: "joint", name, faults };
    if name.trim().is_empty() {
        reader.fault("name", from, "the attribute `name`", "none");
    }
    let mut joint_type = from.attribute("type").unwrap_or("");
    if !TYPES.contains(&joint_type) {
        reader.fault(
            "type",
            from,
            format!("a type of {}", TYPES.join(", ")),
            format!("`{joint_type}`"),
        );
        joint_type = "fixed";
    }
    let mut joint = Element { children: Vec::new(), ..from.clone() };
    joint.attributes = vec![("name".into(), name.into()), ("type".into(), joint_type.into())];
    for (part, is_required) in children("joint") {
        let mut child = reader.only_child(part, from, part, *is_required);
        // The parser asks for what the format does not, and for what could not be read.
        let asked = match *part {
            "limit" => "velocity",
            "safety_controller" => "k_velocity",
            "parent" | "child" => "link",
            _ => "",
        };
        if child.is_none() && *is_required {
            let (attributes, children) = (Vec::new(), Vec::new());
            child = Some(Element { name: (*part).into(), line: from.line, attributes, children });
        }
        if let Some(child) = &mut child
            && !asked.is_empty()
            && child.attribute(asked).is_none()
        {
            child.attributes.push((asked.into(), if asked == "link" { "" } else { "0" }.into()));
        }
        joint.children.extend(child);
    }
    joint
}

fn inertial(found: &urdf_rs::Inertial) -> Inertial {
    let i = &found.inertia;
    let inertia = [[i.ixx, i.ixy, i.ixz], [i.ixy, i.iyy, i.iyz], [i.ixz, i.iyz, i.izz]];
    Inertial { mass: found.mass.value, origin: found.origin.clone().into(), inertia }
}

fn collision(found: urdf_rs::Collision) -> Collision {
    let shape = match found.geometry {
        Geometry::Cylinder { radius, length } => Shape::Cylinder { radius, length },
        Geometry::Capsule { radius, length } => Shape::Capsule { radius, length },
        Geometry::Sphere { radius } => Shape::Sphere { radius },
        Geometry::Box { size } => Shape::Box { size: size.0 },
        Geometry::Mesh { filename, scale } => {
            Shape::Mesh { filename, scale: scale.map_or([1.0; 3], |scale| scale.0) }
        }
    };
    Collision { origin: found.origin.into(), shape }
}

fn joint(cleaned: &Element, raw: &Element, found: urdf_rs::Joint) -> Joint {
    let limit = cleaned.child("limit").and(raw.child("limit"));
    let there = |name, value| limit.and_then(|limit| limit.attribute(name)).map(|_| value);
    Joint {
        limit: Limit {
            line: limit.map(|limit| limit.line),
            lower: there("lower", found.limit.lower),
            upper: there("upper", found.limit.upper),
            velocity: there("velocity", found.limit.velocity),
            effort: there("effort", found.limit.effort),
        },
        line: cleaned.line,
        name: found.name,
        joint_type: found.joint_type,
        parent: found.parent.link,
        child: found.child.link,
        origin: found.origin.into(),
        axis: found.axis.xyz.0,
        soft_limits: found.safety_controller.map(|s| [s.soft_lower_limit, s.soft_upper_limit]),
        mimic: found.mimic.map(|mimic| Mimic {
            joint: mimic.joint,
            multiplier: mimic.multiplier.unwrap_or(1.0),
            offset: mimic.offset.unwrap_or(0.0),
        }),
        dynamics: found
            .dynamics
            .map(|dynamics| Dynamics { damping: dynamics.damping, friction: dynamics.friction }),
    }
}
