//! Boxes, cylinders, capsules and balls as triangles, around them rather than inside.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3};

use crate::triangle::Triangle;

/// Sides of what is round.
const SIDES: usize = 48;
/// What is round sticks out of itself by so much at most, as a factor of its radius: 1 / cos²(π / 32) − 1, that of
/// the capsule.
pub(crate) const EXCESS: f64 = 0.0098;
/// Rings of a half ball.
const RINGS: usize = 8;

/// A box of these edges \[m\], its centre at the origin.
pub(crate) fn cuboid(size: DVec3) -> Vec<Triangle> {
    let corner = |x: f64, y: f64, z: f64| DVec3::new(x, y, z) * size / 2.0;
    let mut triangles = Vec::with_capacity(12);
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let at = |u: f64, v: f64| {
                let mut c = [0.0; 3];
                (c[axis], c[(axis + 1) % 3], c[(axis + 2) % 3]) = (side, u * side, v);
                corner(c[0], c[1], c[2])
            };
            let [a, b, c, d] = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

/// A cylinder along z \[m\].
pub(crate) fn cylinder(radius: f64, length: f64) -> Vec<Triangle> {
    let (r, h) = (radius / (PI / SIDES as f64).cos(), length / 2.0);
    lathe(&[DVec2::new(0.0, -h), DVec2::new(r, -h), DVec2::new(r, h), DVec2::new(0.0, h)])
}

/// A cylinder along z that ends in half balls \[m\]; `length` is that of the cylinder.
pub(crate) fn capsule(radius: f64, length: f64) -> Vec<Triangle> {
    let step = FRAC_PI_2 / RINGS as f64;
    // Around the ball, both along its rings and across them.
    let r = radius / ((PI / SIDES as f64).cos() * (step / 2.0).cos());
    let arc = |i: usize| DVec2::from_angle(i as f64 * step - FRAC_PI_2) * r;
    let below = (0..=RINGS).map(|i| arc(i) - DVec2::Y * (length / 2.0));
    let above = (RINGS..=2 * RINGS).map(|i| arc(i) + DVec2::Y * (length / 2.0));
    lathe(&below.chain(above).collect::<Vec<_>>())
}

/// A ball \[m\].
pub(crate) fn ball(radius: f64) -> Vec<Triangle> {
    capsule(radius, 0.0)
}

/// What a profile (distance from z, height) makes when it goes around z.
fn lathe(profile: &[DVec2]) -> Vec<Triangle> {
    let at = |p: DVec2, side: usize| {
        let angle = DVec2::from_angle(TAU * (side % SIDES) as f64 / SIDES as f64);
        DVec3::new(p.x.max(0.0) * angle.x, p.x.max(0.0) * angle.y, p.y)
    };
    let mut triangles = Vec::new();
    for pair in profile.windows(2) {
        for side in 0..SIDES {
            let [a, b, c, d] = [
                at(pair[0], side),
                at(pair[0], side + 1),
                at(pair[1], side + 1),
                at(pair[1], side),
            ];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    // At the axis one of the two has no area.
    triangles.retain(|[a, b, c]| {
        let longest = (*b - *a).length_squared().max((*c - *a).length_squared());
        (*b - *a).cross(*c - *a).length_squared() > 1e-24 * longest * longest
    });
    triangles
}
