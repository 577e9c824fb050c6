//! Triangles of a COLLADA file, with the file's unit and the placements of its nodes.
//!
//! Of the format it knows what a shape takes: `<triangles>`, `<polylist>`, `<polygons>`, `<trifans>` and
//! `<tristrips>` of `<geometry>`, instanced by the nodes of the scene, also by way of `<instance_node>` and of a
//! `<controller>`'s skin. Equations and element names: COLLADA 1.4.1 specification, chapter 5.

use std::collections::HashMap;

use glam::{DMat4, DVec3};
use roxmltree::{Document, Node, ParsingOptions};

use crate::triangle::{TRIANGLES_MAX, Triangle};

/// Most elements and attributes of a file.
const NODES_MAX: u32 = 2_000_000;
/// So deep are nodes nested and instanced.
const DEPTH_MAX: usize = 64;

type Result<T> = core::result::Result<T, String>;

/// All triangles of a file's scene, in metres.
///
/// # Errors
///
/// What was expected, with the line.
pub(crate) fn triangles(bytes: &[u8]) -> Result<Vec<Triangle>> {
    let text = core::str::from_utf8(bytes).map_err(|error| {
        format!("expected UTF-8, found something else from byte {} on", error.valid_up_to())
    })?;
    check_depth(text)?;
    let options = ParsingOptions { nodes_limit: NODES_MAX, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text.trim_start_matches('\u{feff}'), options)
        .map_err(|error| format!("expected COLLADA, found XML that does not parse: {error}"))?;
    let root = document.root_element();
    if root.tag_name().name() != "COLLADA" {
        return Err(format!("expected <COLLADA>, found <{}>", root.tag_name().name()));
    }
    let ids = root.descendants().filter_map(|node| Some((node.attribute("id")?, node))).collect();
    let mut file = File { ids, triangles: Vec::new() };
    let placement = asset(root)?;
    let scene =
        children(root, "scene").flat_map(|scene| children(scene, "instance_visual_scene")).next();
    match scene {
        Some(instance) => {
            for node in children(file.target(instance, "url")?, "node") {
                file.add_node(node, placement, 0)?;
            }
        }
        // A file of geometry alone is meant as it is.
        None => {
            for library in children(root, "library_geometries") {
                for geometry in children(library, "geometry") {
                    file.add_geometry(geometry, placement)?;
                }
            }
        }
    }
    Ok(file.triangles)
}

/// The parser and the document's end recurse: what would overflow the stack is refused before.
fn check_depth(text: &str) -> Result<()> {
    let mut depth = 0_usize;
    for part in text.split('<').skip(1) {
        let tag = part.split('>').next().unwrap_or("");
        match tag.as_bytes().first() {
            Some(b'/') => depth = depth.saturating_sub(1),
            Some(b'!' | b'?') => {}
            _ if tag.ends_with('/') => {}
            _ => depth += 1,
        }
        if depth > 4 * DEPTH_MAX {
            return Err(format!("expected at most {} nested elements, found more", 4 * DEPTH_MAX));
        }
    }
    Ok(())
}

/// The scale of a file's `<asset>`, into metres.
///
/// Its `<up_axis>` is left alone, as by RViz, with which robot descriptions are looked at: the
/// coordinates are those of the link whatever the file says, of the meshes of TIAGo that say `Y_UP` too.
fn asset(root: Node) -> Result<DMat4> {
    let unit = children(root, "asset").flat_map(|asset| children(asset, "unit")).next();
    let Some((unit, text)) = unit.and_then(|unit| Some((unit, unit.attribute("meter")?))) else {
        return Ok(DMat4::IDENTITY);
    };
    let metre: f64 = number(unit, text.trim_ascii())?;
    if !(metre > 0.0 && metre.is_finite()) {
        return Err(at(
            unit,
            &format!("expected a length above 0 m as unit, found meter=\"{metre}\""),
        ));
    }
    Ok(DMat4::from_scale(DVec3::splat(metre)))
}

struct File<'a> {
    ids: HashMap<&'a str, Node<'a, 'a>>,
    triangles: Vec<Triangle>,
}

impl<'a> File<'a> {
    /// What an attribute refers to.
    fn target(&self, node: Node<'a, 'a>, attribute: &str) -> Result<Node<'a, 'a>> {
        let reference = node.attribute(attribute).unwrap_or("");
        let target = reference.strip_prefix('#').and_then(|id| self.ids.get(id)).copied();
        target.ok_or_else(|| {
            at(node, &format!("expected the id of an element of this file, found \"{reference}\""))
        })
    }

    fn add_node(&mut self, node: Node<'a, 'a>, above: DMat4, depth: usize) -> Result<()> {
        if depth > DEPTH_MAX {
            return Err(at(
                node,
                &format!("expected at most {DEPTH_MAX} nodes inside each other, found more"),
            ));
        }
        let mut placement = above;
        for child in node.children().filter(Node::is_element) {
            placement *= transform(child)?;
        }
        for child in node.children().filter(Node::is_element) {
            match child.tag_name().name() {
                "node" => self.add_node(child, placement, depth + 1)?,
                "instance_node" => {
                    self.add_node(self.target(child, "url")?, placement, depth + 1)?;
                }
                "instance_geometry" => self.add_geometry(self.target(child, "url")?, placement)?,
                "instance_controller" => {
                    let controller = self.target(child, "url")?;
                    for skin in children(controller, "skin") {
                        self.add_geometry(self.target(skin, "source")?, placement)?;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn add_geometry(&mut self, geometry: Node<'a, 'a>, placement: DMat4) -> Result<()> {
        for mesh in children(geometry, "mesh") {
            for primitive in mesh.children().filter(Node::is_element) {
                match primitive.tag_name().name() {
                    "triangles" | "polylist" | "polygons" | "trifans" | "tristrips" => {
                        self.add_primitive(primitive, placement)?;
                    }
                    _ => {}
                }
            }
        }
        Ok(())
    }

    /// Adds the triangles of one list of polygons.
    fn add_primitive(&mut self, primitive: Node<'a, 'a>, placement: DMat4) -> Result<()> {
        let inputs = || children(primitive, "input");
        let offset = |input: Node| {
            input.attribute("offset").and_then(|text| text.parse().ok()).unwrap_or(0_usize)
        };
        let stride = 1 + inputs().map(offset).max().unwrap_or(0);
        let vertex = inputs().find(|input| input.attribute("semantic") == Some("VERTEX"));
        let vertex = vertex
            .ok_or_else(|| at(primitive, "expected an <input> of semantic VERTEX, found none"))?;
        let positions: Vec<_> = self
            .positions(vertex)?
            .into_iter()
            .map(|point| placement.transform_point3(point))
            .collect();
        let mut lists = Vec::new();
        for list in children(primitive, "p")
            .chain(children(primitive, "ph").flat_map(|ph| children(ph, "p")))
        {
            let indices: Vec<usize> = numbers(list)?;
            let corners = indices.chunks(stride).map(|chunk| {
                let index = chunk.get(offset(vertex)).copied();
                index.and_then(|index| positions.get(index)).copied().ok_or_else(|| {
                    let found = index.map_or("none".into(), |index| index.to_string());
                    at(
                        list,
                        &format!(
                            "expected the index of one of {} positions, found {found}",
                            positions.len()
                        ),
                    )
                })
            });
            lists.push(corners.collect::<Result<Vec<DVec3>>>()?);
        }
        let polygons: Vec<&[DVec3]> = match primitive.tag_name().name() {
            "triangles" => lists.iter().flat_map(|list| list.chunks(3)).collect(),
            "polylist" => {
                let counts = children(primitive, "vcount")
                    .next()
                    .map(numbers)
                    .transpose()?
                    .unwrap_or_default();
                let mut rest = lists.first().map_or(&[][..], Vec::as_slice);
                let mut polygons = Vec::new();
                for count in counts {
                    let (polygon, others) = rest.split_at_checked(count).ok_or_else(|| {
                        at(primitive, "expected the corners that <vcount> says, found fewer")
                    })?;
                    polygons.push(polygon);
                    rest = others;
                }
                polygons
            }
            "tristrips" => lists.iter().flat_map(|list| list.windows(3)).collect(),
            _ => lists.iter().map(Vec::as_slice).collect(),
        };
        for polygon in polygons {
            // A fan around the first corner, as of convex polygons.
            for pair in polygon.windows(2).skip(1) {
                self.triangles.push([polygon[0], pair[0], pair[1]]);
            }
        }
        if self.triangles.len() > TRIANGLES_MAX {
            return Err(format!(
                "expected at most {TRIANGLES_MAX} triangles, found more; simplify the mesh"
            ));
        }
        Ok(())
    }

    /// The points that an `<input>` refers to.
    fn positions(&self, input: Node<'a, 'a>) -> Result<Vec<DVec3>> {
        let vertices = self.target(input, "source")?;
        let position = children(vertices, "input")
            .find(|input| input.attribute("semantic") == Some("POSITION"));
        let position = position
            .ok_or_else(|| at(vertices, "expected an <input> of semantic POSITION, found none"))?;
        let source = self.target(position, "source")?;
        let accessor = source.descendants().find(|node| node.has_tag_name_of("accessor"));
        let count = |name| {
            accessor.and_then(|a| a.attribute(name)).and_then(|text| text.parse::<usize>().ok())
        };
        let (stride, first) = (count("stride").unwrap_or(3).max(3), count("offset").unwrap_or(0));
        let array = children(source, "float_array").next();
        let array = array.ok_or_else(|| at(source, "expected a <float_array>, found none"))?;
        let values: Vec<f64> = numbers(array)?;
        let points = values.get(first..).unwrap_or(&[]).chunks_exact(stride);
        Ok(points.map(|v| DVec3::new(v[0], v[1], v[2])).collect())
    }
}

trait TagName {
    fn has_tag_name_of(&self, name: &str) -> bool;
}

impl TagName for Node<'_, '_> {
    /// Whatever its name space is.
    fn has_tag_name_of(&self, name: &str) -> bool {
        self.is_element() && self.tag_name().name() == name
    }
}

/// The matrix of a node's transformation element; of any other element the identity.
fn transform(node: Node) -> Result<DMat4> {
    let values = |count: usize| -> Result<Vec<f64>> {
        let values = numbers(node)?;
        let name = node.tag_name().name();
        (values.len() == count).then_some(values).ok_or_else(|| {
            at(node, &format!("expected {count} numbers in <{name}>, found another number of them"))
        })
    };
    Ok(match node.tag_name().name() {
        "matrix" => {
            let values = values(16)?;
            let rows: [f64; 16] = core::array::from_fn(|i| values[i]);
            DMat4::from_cols_array(&rows).transpose()
        }
        "translate" => DMat4::from_translation(DVec3::from_slice(&values(3)?)),
        "scale" => DMat4::from_scale(DVec3::from_slice(&values(3)?)),
        "rotate" => {
            let values = values(4)?;
            let axis = DVec3::from_slice(&values).normalize_or_zero();
            if axis == DVec3::ZERO {
                DMat4::IDENTITY
            } else {
                DMat4::from_axis_angle(axis, values[3].to_radians())
            }
        }
        name @ ("lookat" | "skew") => {
            return Err(at(node, &format!("<{name}> is not read; apply it to the mesh")));
        }
        _ => DMat4::IDENTITY,
    })
}

fn children<'a>(node: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |child| child.has_tag_name_of(name))
}

/// The numbers that an element lists, also behind a comment.
fn numbers<T: core::str::FromStr>(node: Node) -> Result<Vec<T>> {
    let texts = node.children().filter(Node::is_text).filter_map(|child| child.text());
    texts.flat_map(str::split_ascii_whitespace).map(|text| number(node, text)).collect()
}

fn number<T: core::str::FromStr>(node: Node, text: &str) -> Result<T> {
    text.parse().map_err(|_| {
        at(node, &format!("expected a number, found \"{}\"", tprmp_files::shortened(text)))
    })
}

/// A text with the line of an element.
fn at(node: Node, text: &str) -> String {
    let line = node.document().text_pos_at(node.range().start).row;
    format!("line {line}, <{}>: {text}", node.tag_name().name())
}
