//! What triangles enclose, and how deep a point lies inside.
//!
//! Meshes of vendors are open where links meet, overlap, or turn their faces the wrong way around. So a point
//! counts as inside when no path along a grid leads from it to the outside without crossing a triangle, or
//! when most of the six rays along the axes say so: by the winding number, or by an odd number of crossings.
//! Openings between inside and outside are a surface too, so that depths are not too large there.

use glam::{DVec3, IVec3};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use crate::triangle::{Triangle, ends, has_area};

/// About so many nodes has the grid.
const NODES: f64 = 80_000.0;
/// No finer than this \[m\]; arms are not made more exactly.
const STEP_MIN_M: f64 = 0.001;
/// So many of the six rays have to agree.
const MAJORITY: i32 = 4;
/// Nodes are a little off round coordinates, where the edges of meshes lie.
const OFFSET: DVec3 = DVec3::new(0.317, 0.411, 0.373);

/// A place for a sphere: inside, with the distance to the outside.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Centre {
    /// Where it is \[m\].
    pub(crate) at: DVec3,
    /// Distance to the nearest surface that is seen from outside \[m\]; 0 on the surface.
    pub(crate) depth: f64,
}

/// What triangles enclose.
pub(crate) struct Solid {
    outer: TriMesh,
    grid: Grid,
    inside: Vec<bool>,
}

impl Solid {
    /// From the triangles of a link; `None` where none has an area.
    pub(crate) fn new(triangles: &[Triangle]) -> Option<Self> {
        let grid = Grid::around(triangles);
        let crossings = core::array::from_fn(|axis| grid.crossings(triangles, axis));
        let inside = grid.inside(&crossings);
        let outer: Vec<_> = triangles.iter().filter(|t| grid.touches_outside(t, &inside)).collect();
        let outer = if outer.is_empty() { triangles.iter().collect() } else { outer };
        let mut vertices: Vec<_> = outer.iter().filter(|t| has_area(t)).flat_map(|t| **t).collect();
        vertices.extend(grid.openings(&crossings, &inside).into_iter().flatten());
        let faces = (0..vertices.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Some(Self { outer: TriMesh::new(vertices, faces).ok()?, grid, inside })
    }

    /// Distance from a point to the nearest surface that is seen from outside \[m\].
    pub(crate) fn distance(&self, point: DVec3) -> f64 {
        self.outer.distance_to_local_point(point, false)
    }

    /// Distance of the grid's nodes \[m\].
    pub(crate) fn step(&self) -> f64 {
        self.grid.step
    }

    /// Nodes near the medial surface: a ball around any other, up to the surface, lies nearly in that of a
    /// neighbour.
    pub(crate) fn medial_centres(&self) -> Vec<Centre> {
        /// The depth rises by sin α a step where two faces meet at 2α: flat angles need no centres of their own.
        const SLOPE_MAX: f64 = 0.85;
        let grid = &self.grid;
        let depths: Vec<f64> =
            (0..self.inside.len())
                .map(|node| {
                    if self.inside[node] { self.distance(grid.place(grid.cell(node))) } else { 0.0 }
                })
                .collect();
        let mut centres = Vec::new();
        for node in (0..depths.len()).filter(|node| self.inside[*node]) {
            let (cell, depth) = (grid.cell(node), depths[node]);
            let is_covered = neighbours(2).any(|by| {
                let other = grid.node(cell + by);
                other.is_some_and(|other| {
                    depths[other] - depth > SLOPE_MAX * grid.step * by.as_dvec3().length()
                })
            });
            if !is_covered {
                centres.push(Centre { at: grid.place(cell), depth });
            }
        }
        centres
    }
}

/// The cells around one, itself left out.
fn neighbours(reach: i32) -> impl Iterator<Item = IVec3> {
    let range = move || -reach..=reach;
    let all = range()
        .flat_map(move |x| range().flat_map(move |y| range().map(move |z| IVec3::new(x, y, z))));
    all.filter(|by| *by != IVec3::ZERO)
}

/// Nodes at equal distances, with at least one layer outside on each side.
struct Grid {
    origin: DVec3,
    step: f64,
    size: IVec3,
}

/// Where the line of nodes along an axis crosses triangles: for each line the coordinate along the axis \[m\],
/// and +1 where the line leaves, −1 where it enters, by the triangle's orientation. Ascending.
type Crossings = Vec<Vec<(f64, i32)>>;

impl Grid {
    fn around(triangles: &[Triangle]) -> Self {
        let (low, high) = ends(triangles.iter().flatten().copied());
        let extent = (high - low).max(DVec3::splat(STEP_MIN_M));
        // A thin plate is a volume too.
        let volume = extent.max(DVec3::splat(0.05 * extent.max_element())).element_product();
        let step = (volume / NODES).cbrt().max(STEP_MIN_M);
        let size = (extent / step).ceil().as_ivec3() + 3;
        Self { origin: low - (DVec3::ONE + OFFSET) * step, step, size }
    }

    fn place(&self, cell: IVec3) -> DVec3 {
        self.origin + cell.as_dvec3() * self.step
    }

    fn node(&self, cell: IVec3) -> Option<usize> {
        let within = cell.cmpge(IVec3::ZERO).all() && cell.cmplt(self.size).all();
        within.then(|| ((cell.z * self.size.y + cell.y) * self.size.x + cell.x) as usize)
    }

    fn cell(&self, node: usize) -> IVec3 {
        let (x, y) = (self.size.x as usize, self.size.y as usize);
        IVec3::new((node % x) as i32, (node / x % y) as i32, (node / x / y) as i32)
    }

    /// The line through a cell along an axis.
    fn line(&self, cell: IVec3, axis: usize) -> usize {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        (cell[v] * self.size[u] + cell[u]) as usize
    }

    fn crossings(&self, triangles: &[Triangle], axis: usize) -> Crossings {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut lines = vec![Vec::new(); (self.size[u] * self.size[v]) as usize];
        for triangle in triangles {
            // In steps of the grid.
            let [a, b, c] = triangle.map(|corner| (corner - self.origin) / self.step);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let edge = |p: DVec3, q: DVec3, x: f64, y: f64| {
                (q[u] - p[u]) * (y - p[v]) - (q[v] - p[v]) * (x - p[u])
            };
            let area = edge(a, b, c[u], c[v]);
            for y in low[v].ceil() as i32..=high[v].floor() as i32 {
                for x in low[u].ceil() as i32..=high[u].floor() as i32 {
                    let (px, py) = (f64::from(x), f64::from(y));
                    let weights = [edge(b, c, px, py), edge(c, a, px, py), edge(a, b, px, py)]
                        .map(|w| w / area);
                    if weights.iter().all(|w| *w >= 0.0) {
                        let at = weights[0] * a[axis] + weights[1] * b[axis] + weights[2] * c[axis];
                        let sign = if area > 0.0 { 1 } else { -1 };
                        lines[(y * self.size[u] + x) as usize].push((at, sign));
                    }
                }
            }
        }
        for line in &mut lines {
            line.sort_by(|a: &(f64, i32), b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            // The same face twice, as drawn from both sides, is one.
            line.dedup_by(|a, b| (a.0 - b.0).abs() < 1e-6);
        }
        lines
    }

    fn inside(&self, crossings: &[Crossings; 3]) -> Vec<bool> {
        let reached = self.reached(crossings);
        let vote = |node: usize| {
            let cell = self.cell(node);
            let (mut winding, mut odd) = (0, 0);
            for (axis, lines) in crossings.iter().enumerate() {
                let line = &lines[self.line(cell, axis)];
                let before = line.partition_point(|(at, _)| *at < f64::from(cell[axis]));
                let sum = |part: &[(f64, i32)]| part.iter().map(|(_, sign)| sign).sum::<i32>();
                // Clipped, so that one line through a wrong face does not outvote the others.
                winding += sum(&line[before..]).clamp(-1, 1) - sum(&line[..before]).clamp(-1, 1);
                odd += (before % 2 + (line.len() - before) % 2) as i32;
            }
            winding.abs() >= MAJORITY || odd >= MAJORITY
        };
        (0..reached.len()).map(|node| !reached[node] || vote(node)).collect()
    }

    /// Nodes to which a path along the grid leads from outside.
    fn reached(&self, crossings: &[Crossings; 3]) -> Vec<bool> {
        let mut reached = vec![false; self.size.as_i64vec3().element_product() as usize];
        let mut open = vec![IVec3::ZERO];
        reached[0] = true;
        while let Some(cell) = open.pop() {
            for next in self.open_neighbours(crossings, cell).map(|(next, _)| next) {
                if let Some(node) = self.node(next).filter(|node| !reached[*node]) {
                    reached[node] = true;
                    open.push(next);
                }
            }
        }
        reached
    }

    /// The cells beside one that no triangle separates from it, with their axes.
    fn open_neighbours(
        &self,
        crossings: &[Crossings; 3],
        cell: IVec3,
    ) -> impl Iterator<Item = (IVec3, usize)> {
        let sides =
            (0..3).flat_map(move |axis| [-1, 1].map(|by| (cell + IVec3::AXES[axis] * by, axis)));
        sides.filter(move |(next, axis)| {
            let line = &crossings[*axis][self.line(cell, *axis)];
            let low = f64::from(cell[*axis].min(next[*axis]));
            line.get(line.partition_point(|(at, _)| *at < low))
                .is_none_or(|(at, _)| *at > low + 1.0)
        })
    }

    /// Squares that close the openings of a mesh: at nodes inside from which a step leads outside through no triangle.
    fn openings(&self, crossings: &[Crossings; 3], inside: &[bool]) -> Vec<Triangle> {
        let mut triangles = Vec::new();
        for cell in (0..inside.len()).filter(|node| inside[*node]).map(|node| self.cell(node)) {
            for (next, axis) in self.open_neighbours(crossings, cell) {
                if self.node(next).is_some_and(|node| !inside[node]) {
                    let half = |axis: usize| DVec3::AXES[axis % 3] * (self.step / 2.0);
                    let (at, u, v) = (self.place(cell), half(axis + 1), half(axis + 2));
                    let [a, b, c, d] = [at - u - v, at + u - v, at + u + v, at - u + v];
                    triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
        triangles
    }

    /// Whether there is a node outside near a triangle.
    fn touches_outside(&self, triangle: &Triangle, inside: &[bool]) -> bool {
        let (low, high) = ends(triangle.map(|corner| (corner - self.origin) / self.step));
        let (low, high) = (low.floor().as_ivec3() - 1, high.ceil().as_ivec3() + 1);
        (low.z..=high.z).any(|z| {
            (low.y..=high.y).any(|y| {
                let mut cells = (low.x..=high.x).map(|x| IVec3::new(x, y, z));
                cells.any(|cell| self.node(cell).is_none_or(|node| !inside[node]))
            })
        })
    }
}
