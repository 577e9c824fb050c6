//! The one place that draws: figures as SVG text, and pages of them.
//!
//! A [`Figure`] has a title, a legend and [`Panel`]s in rows. A panel is one pair of axes: a *map* with
//! equal scales, or a *graph* of a given size, linear or logarithmic. Points are given in the units of the
//! axes, widths and offsets in pixels. Text is left to the viewer's fonts; the same input gives the same
//! bytes.
//!
//! ```
//! use glam::DVec2;
//! use tprmp_drawing::{BLUE, Cell, Figure, Page, Panel, Picture, Sign, Stroke};
//!
//! let path: Vec<_> = (0..60).map(|i| DVec2::from_angle(0.1 * f64::from(i))).collect();
//! let range = [DVec2::splat(-1.2), DVec2::splat(1.2)];
//! let mut panel = Panel::map("", ["x [m]", "y [m]"], range, 200.0);
//! let stroke = Stroke::solid(BLUE, 2.0);
//! panel.line(path, &stroke);
//! let figure = Figure::single("A circle", [("path", Sign::Line(stroke))], panel);
//!
//! let mut page = Page::new("Circles");
//! page.table(&["radius [m]"], [vec![Cell::from("1")]]);
//! page.pictures([&Picture { name: "circle".into(), svg: figure.svg(), caption: String::new() }]);
//! assert!(page.html().contains("</svg>"));
//! ```
//!
//! Skills in space are drawn on a [`Canvas`]: a panel for each [`View`], with frames and their names.

mod canvas;
mod colour;
mod figure;
mod page;
mod panel;
mod projection;
mod quantile;
mod text;
mod ticks;
mod turntable;

pub use canvas::Canvas;
pub use colour::{
    AXES, BLACK, BLUE, GREEN, GREY, INK, ORANGE, PURPLE, RED, Scale, of_phase, pale_of_phase,
};
pub use figure::{Figure, Sign};
pub use page::{Cell, Page, Picture};
pub use panel::{Anchor, Panel, Stroke};
pub use projection::{Bounds, Ellipsoid, PLANE, SPACE, View, principal_axes};
pub use quantile::quantile;
pub use text::{escape, number};
pub use ticks::decades;
pub use turntable::{Body, Turntable};
