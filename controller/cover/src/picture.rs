//! What a cover looks like: a page with the links, which can be turned, and a table.

use tprmp_drawing::{Body, Cell, Page, Turntable};

use crate::Cover;

impl Cover {
    /// An HTML page of the links in the middle of their joints' ranges, with their spheres. It needs no other file.
    #[must_use]
    pub fn page(&self, title: &str) -> String {
        let mut page = Page::new(title);
        page.paragraph(&self.summary());
        let bodies = self.links.iter().filter(|link| link.has_shape()).map(|link| Body {
            name: link.link.clone(),
            triangles: link
                .triangles
                .iter()
                .map(|t| t.map(|corner| link.placement.transform_point3(corner)))
                .collect(),
            spheres: link
                .spheres
                .iter()
                .map(|s| (link.placement.transform_point3(s.centre), s.radius))
                .collect(),
        });
        let caption = "Joints in the middle of their ranges.".into();
        page.turntable(&Turntable { name: "links".into(), bodies: bodies.collect(), caption });
        let head = [
            "link",
            "meshes",
            "other shapes",
            "spheres",
            "radii [mm]",
            "protrusion at most [mm]",
            "kept clear",
        ];
        let rows = self.links.iter().map(|link| {
            let verdict = match (link.missing.is_empty(), link.has_shape()) {
                (false, _) => Cell::verdict(Some(false), "no").with_details(
                    &format!("{} meshes without a shape", link.missing.len()),
                    &link.missing.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "),
                ),
                (true, true) => Cell::verdict(Some(true), "yes"),
                (true, false) => Cell::verdict(None, "has no shape"),
            };
            let protrusion = if link.has_shape() {
                format!("{:.1}", link.protrusion_m * 1e3)
            } else {
                String::new()
            };
            vec![
                link.link.as_str().into(),
                link.meshes.to_string().into(),
                link.primitives.to_string().into(),
                link.spheres.len().to_string().into(),
                link.radii().into(),
                protrusion.into(),
                verdict,
            ]
        });
        page.table(&head, rows);
        page.html()
    }
}
