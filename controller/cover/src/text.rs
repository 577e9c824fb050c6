//! A cover in words, and as the control points of a configuration.

use core::fmt::{self, Display, Write};

use crate::{Cover, LinkCover, MissingMesh};

impl Display for MissingMesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "mesh `{}`: {}", tprmp_files::printable(&self.filename), self.fault)
    }
}

impl LinkCover {
    /// Whether there is anything to cover.
    #[must_use]
    pub fn has_shape(&self) -> bool {
        !self.spheres.is_empty()
    }

    /// Least and largest radius \[mm\], in words.
    pub(crate) fn radii(&self) -> String {
        let radii = || self.spheres.iter().map(|sphere| sphere.radius * 1e3);
        let (least, most) = (radii().fold(f64::INFINITY, f64::min), radii().fold(0.0, f64::max));
        match self.spheres.len() {
            0 => String::new(),
            1 => format!("{most:.0}"),
            _ => format!("{least:.0} to {most:.0}"),
        }
    }
}

impl Cover {
    /// How many spheres there are, how far they stick out, and whether that is what was asked for.
    #[must_use]
    pub fn summary(&self) -> String {
        let links = self.links.iter().filter(|link| link.has_shape()).count();
        let text = format!(
            "{} spheres on {links} links stick out by at most {:.1} mm",
            self.sphere_count(),
            self.protrusion_m * 1e3
        );
        let (asked, most) = (self.asked.protrusion_m * 1e3, self.asked.spheres_max);
        if self.is_within() {
            return format!("{text}; asked for were {asked:.1} mm, and at most {most} spheres");
        }
        format!("{text}; the {asked:.1} mm that were asked for would take more than {most} spheres")
    }

    /// The spheres as the value of a configuration's key `robot.control_points`, in RON.
    #[must_use]
    pub fn control_points_ron(&self) -> String {
        let mut text = String::from("Some([\n");
        for link in &self.links {
            for sphere in &link.spheres {
                let [x, y, z] = (sphere.centre + 0.0).to_array();
                // Writing to a string cannot fail.
                let _ = writeln!(
                    text,
                    "    (link: {:?}, position_m: ({x:.4}, {y:.4}, {z:.4}), radius_m: {:.4}),",
                    link.link, sphere.radius
                );
            }
        }
        text + "])\n"
    }
}
