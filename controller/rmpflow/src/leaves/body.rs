//! Bodies: what keeps clear.

use core::ops::Range;

use glam::DVec3;
use nalgebra::{SMatrix, Vector3};
use tprmp_spatial::PointMotion;

use crate::leaves::obstacle::Shape;

/// Points of a body that stay where they are among each other, and a ball around their balls.
#[derive(Debug, Clone)]
pub struct Part {
    /// Centre \[m\].
    pub position: DVec3,
    /// Radius \[m\].
    pub radius: f64,
    /// Which points; they follow one another.
    pub points: Range<usize>,
}

/// The points of a body that keep clear, each the centre of a ball.
pub trait Body<const N: usize> {
    /// How many there are.
    fn count(&self) -> usize;
    /// How many parts the points make up: each its own, unless the body knows better.
    fn part_count(&self) -> usize {
        self.count()
    }
    /// Part `k`, below [`Body::part_count`]. A whole part is passed over where it is far from all.
    fn part(&self, k: usize) -> Part {
        let (position, radius) = self.ball(k);
        Part { position, radius, points: k..k + 1 }
    }
    /// Position \[m\] and radius \[m\] of point `i`, below [`Body::count`].
    fn ball(&self, i: usize) -> (DVec3, f64);
    /// Motion of point `i`.
    fn motion(&self, i: usize) -> PointMotion<N>;
    /// Clearance within which point `i` keeps clear of an obstacle of this shape, where that is less
    /// than the leaf's; 0 where it does not \[m\].
    fn acts_within(&self, i: usize, shape: &Shape) -> f64;
    /// Where point `i` is once the task is done, as far as that is known \[m\].
    fn at_goal(&self, i: usize) -> Option<DVec3>;
}

/// A ball that moves freely: its first coordinates are x, y and, where there are three, z.
#[derive(Debug, Clone, Copy)]
pub struct FreeBall {
    /// Centre \[m\].
    pub position: DVec3,
    /// Velocity \[m/s\].
    pub velocity: DVec3,
    /// Radius \[m\].
    pub radius: f64,
    /// Goal \[m\].
    pub goal: DVec3,
}

impl<const N: usize> Body<N> for FreeBall {
    fn count(&self) -> usize {
        1
    }

    fn ball(&self, _: usize) -> (DVec3, f64) {
        (self.position, self.radius)
    }

    fn motion(&self, _: usize) -> PointMotion<N> {
        PointMotion {
            position: self.position,
            velocity: self.velocity,
            jacobian: SMatrix::identity(),
            drift: Vector3::zeros(),
        }
    }

    fn acts_within(&self, _: usize, _: &Shape) -> f64 {
        f64::INFINITY
    }

    fn at_goal(&self, _: usize) -> Option<DVec3> {
        Some(self.goal)
    }
}
