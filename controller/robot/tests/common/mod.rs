//! Robots and seeded random states shared by the tests.

#![allow(dead_code, reason = "each test binary uses a part of this module")]

pub(crate) mod variants;

use std::path::PathBuf;

use glam::DVec3;
use nalgebra::SVector;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tprmp_robot::Chain;

/// Gravitational acceleration in the base frame of an arm on the floor [m/s²].
pub(crate) const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);

/// States a test tries.
pub(crate) const STATES: usize = 200;

/// A robot of the repository.
pub(crate) fn robot_file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config/robots").join(name)
}

pub(crate) fn ur5() -> Chain<6> {
    Chain::from_urdf(robot_file("ur5.urdf"), "suction_tip").unwrap()
}

pub(crate) fn point2d() -> Chain<2> {
    Chain::from_urdf(robot_file("point2d.urdf"), "point").unwrap()
}

/// A chain that has what the robots of the repository lack: skew axes, a prismatic and a continuous
/// joint between revolute ones, full inertia tensors, rotated inertia frames, side branches.
pub(crate) fn skew() -> Chain<4> {
    Chain::from_urdf(data_file("skew.urdf"), "hand").unwrap()
}

pub(crate) fn data_file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// Position, velocity and acceleration.
pub(crate) type State<const N: usize> = [SVector<f64, N>; 3];

/// `STATES` random states; the same seed gives the same states.
pub(crate) fn states<const N: usize>(seed: u64) -> impl Iterator<Item = State<N>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..STATES)
        .map(move |_| std::array::from_fn(|_| SVector::from_fn(|_, _| rng.random_range(-3.0..3.0))))
}

/// A robot of pybullet's own data package, in the environment that `make venv` sets up.
pub(crate) fn pybullet_file(name: &str) -> PathBuf {
    let venv = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../target/venv/lib");
    let pythons = std::fs::read_dir(&venv)
        .unwrap_or_else(|error| panic!("{}: {error}; run `make venv`", venv.display()));
    let file = pythons
        .flatten()
        .map(|python| python.path().join("site-packages/pybullet_data").join(name))
        .find(|file| file.exists());
    file.unwrap_or_else(|| panic!("{name} is not in {}: run `make venv`", venv.display()))
}
