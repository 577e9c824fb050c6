//! Fields of the plane: filled contours of numbers, arrows for vectors.

use contour::ContourBuilder;
use glam::DVec2;

use tprmp_drawing::{Panel, Scale};

/// Side of a cell in which a field is evaluated once [px].
const CELL_PX: f64 = 4.0;
/// Distance of arrows, and the length of the longest and the shortest [px].
const ARROW_STEP_PX: f64 = 25.0;
const ARROW_LENGTHS_PX: [f64; 2] = [9.0, 24.0];
/// Edge of a band: a dark hair line.
const EDGE: &str = "rgba(0,0,0,0.13)";

/// A field's numbers at the centres of cells that cover a panel and a little more.
#[derive(Debug, Clone)]
pub struct Grid {
    low: DVec2,
    cell: DVec2,
    count: [usize; 2],
    values: Vec<f64>,
}

impl Grid {
    /// Evaluates a field for a panel.
    pub fn new(panel: &Panel, mut field: impl FnMut(DVec2) -> f64) -> Self {
        let [low, high] = panel.range();
        let inner = (panel.size() / CELL_PX).ceil().max(DVec2::splat(2.0));
        let cell = (high - low) / inner;
        // One cell more on each side: contours close outside of the panel.
        let count = [inner.x as usize + 2, inner.y as usize + 2];
        let low = low - cell;
        let at = |i: usize| {
            let (column, row) = ((i % count[0]) as f64, (i / count[0]) as f64);
            low + cell * (DVec2::new(column, row) + 0.5)
        };
        let values = (0..count[0] * count[1]).map(|i| field(at(i))).collect();
        Self { low, cell, count, values }
    }

    /// Its numbers.
    pub fn values(&self) -> impl Iterator<Item = f64> + '_ {
        self.values.iter().copied()
    }

    /// Draws it as filled contours: each level covers what is above it.
    pub fn draw(&self, panel: &mut Panel, scale: &Scale) {
        let [low, high] = panel.range();
        let all = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
        panel.area([all.as_slice()], &scale.colour(0), "none");
        let inner = &scale.levels()[1..scale.bands()];
        for (band, rings) in self.above(inner).iter().enumerate() {
            panel.area(rings.iter().map(Vec::as_slice), &scale.colour(band + 1), EDGE);
        }
    }

    /// Draws where it is above a level.
    pub fn draw_above(&self, panel: &mut Panel, level: f64, colour: &str) {
        for rings in self.above(&[level]) {
            panel.area(rings.iter().map(Vec::as_slice), colour, EDGE);
        }
    }

    /// The rings around what is above each level.
    fn above(&self, levels: &[f64]) -> Vec<Vec<Vec<DVec2>>> {
        let lines = ContourBuilder::new(self.count[0], self.count[1], true)
            .x_origin(self.low.x)
            .y_origin(self.low.y)
            .x_step(self.cell.x)
            .y_step(self.cell.y)
            .lines(&self.values, levels)
            .expect("there is a value for each cell");
        let rings = lines.iter().map(|line| {
            let rings = line.geometry().0.iter();
            rings.map(|ring| ring.0.iter().map(|p| DVec2::new(p.x, p.y)).collect()).collect()
        });
        rings.collect()
    }
}

/// A field's vectors on a lattice over a panel.
#[derive(Debug, Clone)]
pub struct Arrows(Vec<(DVec2, DVec2)>);

impl Arrows {
    /// Evaluates a field for a panel.
    pub fn new(panel: &Panel, mut field: impl FnMut(DVec2) -> DVec2) -> Self {
        Self(
            lattice(panel, (panel.size() / ARROW_STEP_PX).floor()).map(|p| (p, field(p))).collect(),
        )
    }

    /// Their magnitudes.
    pub fn magnitudes(&self) -> impl Iterator<Item = f64> + '_ {
        self.0.iter().map(|(_, vector)| vector.length())
    }

    /// Draws them, coloured by magnitude; the stronger, the longer.
    pub fn draw(&self, panel: &mut Panel, scale: &Scale) {
        let [short, long] = ARROW_LENGTHS_PX;
        for (point, vector) in &self.0 {
            let band = scale.band(vector.length());
            let fraction = (band as f64 + 0.5) / scale.bands() as f64;
            let length = short + (long - short) * fraction;
            let arrow = vector.normalize_or_zero() * length;
            panel.arrow(*point, arrow, &scale.colour(band));
        }
    }
}

/// Points in the middle of so many columns and rows of a panel.
pub fn lattice(panel: &Panel, count: DVec2) -> impl Iterator<Item = DVec2> + use<> {
    let [low, high] = panel.range();
    let count = count.max(DVec2::ONE);
    let (columns, rows) = (count.x as usize, count.y as usize);
    (0..columns * rows).map(move |i| {
        let at = DVec2::new((i % columns) as f64, (i / columns) as f64) + 0.5;
        low + (high - low) * at / count
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The contour of a linear field is where it should be, in the middle and at the edge.
    #[test]
    fn contours_lie_where_the_field_says() {
        let panel =
            || Panel::map("", ["", ""], [DVec2::new(-1.0, 2.0), DVec2::new(1.0, 3.0)], 200.0);
        let grid = Grid::new(&panel(), |p| p.x);
        let lines = ContourBuilder::new(grid.count[0], grid.count[1], true)
            .x_origin(grid.low.x)
            .y_origin(grid.low.y)
            .x_step(grid.cell.x)
            .y_step(grid.cell.y)
            .lines(&grid.values, &[0.305])
            .unwrap();
        let ring = &lines[0].geometry().0[0].0;
        let left = ring.iter().filter(|p| p.y > 2.0 && p.y < 3.0).map(|p| p.x);
        let least = left.clone().fold(f64::INFINITY, f64::min);
        assert!((least - 0.305).abs() < 1e-12, "{least}");
        assert!(left.fold(0.0, f64::max) > 1.0);
        let mut panel = panel();
        grid.draw(&mut panel, &Scale::areas_of_roots(grid.values(), ""));
    }
}
