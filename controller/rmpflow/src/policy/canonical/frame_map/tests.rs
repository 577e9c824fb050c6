use super::*;
use tprmp_spatial::{SpatialAcceleration, Twist};

fn pose(position: [f64; 3], rotation: [f64; 3]) -> Pose {
    Pose { position: position.into(), orientation: DQuat::from_scaled_axis(rotation.into()) }
}

fn anchors() -> [Anchor; 3] {
    let start = pose([0.4, 0.1, 0.3], [0.0, 0.2, 0.1]);
    let between = pose([0.7, -0.1, 0.1], [0.1, 0.0, -0.4]);
    let goal_frame = pose([0.5, -0.25, 0.03], [0.0, 0.0, 0.3]);
    [
        Anchor { index: 0, frame: start, point: start.position, phase: 0.0 },
        Anchor { index: 2, frame: between, point: DVec3::new(0.72, -0.1, 0.2), phase: 0.4 },
        Anchor { index: 1, frame: goal_frame, point: goal().position, phase: 1.0 },
    ]
}

fn goal() -> Pose {
    pose([0.505, -0.248, 0.058], [3.0, 0.1, 0.2])
}

/// With and without a frame in between, with and without positions that rotate.
fn maps() -> Vec<FrameMap> {
    let [start, between, goal_frame] = anchors();
    let mut maps = Vec::new();
    for rotate in [true, false] {
        maps.push(FrameMap::new(&[start, goal_frame], goal(), rotate).unwrap());
        maps.push(FrameMap::new(&[start, between, goal_frame], goal(), rotate).unwrap());
        maps.push(FrameMap::new(&[goal_frame], goal(), rotate).unwrap());
        maps.push(maps[maps.len() - 3].with_adaptation(Some(adaptation())));
    }
    maps
}

/// Shifts by some millimetres and tenths of degrees.
fn adaptation() -> Adaptation {
    let entry = |k: usize| 0.01 * (k as f64 * 1.37).sin();
    let coefficients = core::array::from_fn(|j| {
        core::array::from_fn(|a| core::array::from_fn(|b| entry(36 * j + 6 * a + b)))
    });
    Adaptation { reach: [0.3, 0.5], coefficients }
}

/// A frame on a curve in time: its pose, and its exact motion by construction.
fn moving(t: f64, speed: f64, origin: DVec3) -> MovingPose {
    let spin = speed * t + 0.1 * t * t;
    MovingPose {
        pose: Pose {
            position: origin + DVec3::new(0.15 * (speed * t).sin(), 0.1 * t * t, -0.2 * speed * t),
            orientation: DQuat::from_rotation_z(spin) * DQuat::from_rotation_x(0.2 * speed),
        },
        velocity: Twist {
            linear: DVec3::new(0.15 * speed * (speed * t).cos(), 0.2 * t, -0.2 * speed),
            angular: DVec3::Z * (speed + 0.2 * t),
        },
        acceleration: SpatialAcceleration {
            linear: DVec3::new(-0.15 * speed * speed * (speed * t).sin(), 0.2, 0.0),
            angular: DVec3::Z * 0.2,
        },
    }
}

/// Far from their canonical places: the goal on the other side of the start.
fn frames(t: f64) -> [MovingPose; 3] {
    [
        moving(t, -0.3, DVec3::new(0.42, 0.12, 0.31)),
        moving(t, 0.8, DVec3::new(0.3, 0.6, 0.5)),
        moving(t, 1.4, DVec3::new(0.1, 0.1, 0.3)),
    ]
}

fn points() -> impl Iterator<Item = Canonical> {
    (0..60).map(|i| {
        let s = f64::from(i);
        Canonical {
            position: DVec3::new(
                0.45 + 0.2 * (s * 1.7).sin(),
                -0.1 + 0.35 * (s * 0.9).cos(),
                0.2 + 0.15 * (s * 0.37).sin(),
            ),
            rotation: DVec3::new((s * 0.3).sin(), 0.8 * (s * 0.7).cos(), 0.5 - 0.01 * s),
        }
    })
}

fn phases() -> impl Iterator<Item = f64> {
    (0..60).map(|i| -0.2 + 1.4 * f64::from(i) / 59.0)
}

#[test]
fn ramp_is_flat_outside_and_its_derivatives_are_right() {
    for rise in [0.1, RISE, 0.5] {
        for t in [-2.0, 0.0] {
            assert_eq!(ramp(t, rise), [0.0; 3]);
            assert_eq!(ramp(1.0 - t, rise).map(f64::abs), [1.0, 0.0, 0.0]);
        }
        let h = 1e-6;
        for i in -10..30 {
            let t = 0.07 * f64::from(i) + 0.001;
            let [_, first, second] = ramp(t, rise);
            let (before, after) = (ramp(t - h, rise), ramp(t + h, rise));
            assert!((first - (after[0] - before[0]) / (2.0 * h)).abs() < 1e-8);
            assert!((second - (after[1] - before[1]) / (2.0 * h)).abs() < 1e-4);
            assert!((0.0..=1.0 / (1.0 - rise)).contains(&first));
        }
    }
}

#[test]
fn canonical_frames_map_to_themselves_and_moved_ones_transport_their_anchors() {
    for map in maps() {
        let still = [0, 1, 2].map(|index| {
            let anchor = anchors().into_iter().find(|anchor| anchor.index == index).unwrap();
            MovingPose::at_rest(anchor.frame)
        });
        let d = map.transforms(&still).unwrap();
        for (y, phase) in points().zip(phases()) {
            assert!((map.forward(&d, phase, &y).position - y.position).length() < 1e-14);
        }
        let moved = frames(0.3);
        let d = map.transforms(&moved).unwrap();
        for anchor in map.anchors() {
            let y = Canonical { position: anchor.point, rotation: DVec3::ZERO };
            let image = map.forward(&d, anchor.phase, &y);
            let held = Pose { position: anchor.point, ..goal() };
            let expected = moved[anchor.index].pose.compose(&anchor.frame.inverse().compose(&held));
            assert!((image.position - expected.position).length() < 1e-12);
            assert!(image.rotation_from(&expected).length() < 1e-12);
        }
        let y = Canonical { position: goal().position, rotation: DVec3::ZERO };
        let image = map.forward(&d, 1.0, &y);
        let expected = map.goal_among(&moved).unwrap();
        assert!((image.position - expected.position).length() < 1e-12);
        assert!(image.rotation_from(&expected).length() < 1e-12);
    }
}

#[test]
fn with_one_frame_the_whole_space_moves_rigidly() {
    let map = FrameMap::new(&anchors()[2..], goal(), true).unwrap();
    assert_eq!(map.frame_count(), 2);
    let moved = frames(0.3);
    let d = map.transforms(&moved).unwrap();
    for (y, phase) in points().zip(phases()) {
        let expected = moved[1]
            .pose
            .compose(&map.goal_frame().inverse())
            .compose(&Pose { position: y.position, orientation: DQuat::IDENTITY });
        let image = map.forward(&d, phase, &y);
        assert!((image.position - expected.position).length() < 1e-12);
    }
}

#[test]
fn inverse_undoes_forward_at_any_phase() {
    for map in maps() {
        let d = map.transforms(&frames(0.5)).unwrap();
        for (y, phase) in points().zip(phases()) {
            let back = map.inverse(&d, phase, &map.forward(&d, phase, &y));
            assert!((back.position - y.position).length() < 1e-12);
            assert!((back.rotation - y.rotation).length() < 1e-12);
        }
    }
}

/// Follows x(t) = forward(frames(t), s(t), y(t)) for straight y(t) and s(t), so that ÿ = s̈ = 0,
/// and compares the map at t = 0.4 with finite differences.
#[test]
fn velocity_drift_and_jacobian_agree_with_finite_differences() {
    let t0 = 0.4;
    for map in maps() {
        for (i, (y, phase)) in points().zip(phases()).enumerate() {
            let s = i as f64;
            let phase_rate = 0.6 * (s * 0.21).cos();
            let rate = Canonical {
                position: DVec3::new((s * 0.8).cos(), 0.7 * (s * 0.3).sin(), -0.4),
                rotation: DVec3::new(0.5, (s * 0.45).sin(), -0.8 * (s * 0.2).cos()),
            };
            let at = |t: f64| {
                let moved = Canonical {
                    position: y.position + rate.position * t,
                    rotation: y.rotation + rate.rotation * t,
                };
                let d = map.transforms(&frames(t0 + t)).unwrap();
                map.forward(&d, phase + phase_rate * t, &moved)
            };
            let h = 1e-4;
            let (before, now, after) = (at(-h), at(0.0), at(h));
            let linear = (after.position - before.position) / (2.0 * h);
            let angular = after.rotation_from(&before) / (2.0 * h);
            let linear_acceleration =
                (after.position - 2.0 * now.position + before.position) / (h * h);
            let angular_acceleration =
                (after.rotation_from(&now) - now.rotation_from(&before)) / (h * h);
            let d = map.transforms(&frames(t0)).unwrap();
            let transported = map.at(&d, phase, phase_rate);
            let position = transported.position(now.position, linear);
            let rotation = transported.rotation(now.orientation, angular);
            let velocity_error = (position.velocity - rate.position).length()
                + (rotation.velocity - rate.rotation).length();
            assert!(velocity_error < 5e-6, "{velocity_error:e}");
            // ÿ = 0 = J ẍ + drift.
            let drift_error = (position.jacobian * linear_acceleration + position.drift).length()
                + (rotation.jacobian * angular_acceleration + rotation.drift).length();
            assert!(drift_error < 3e-5, "{drift_error:e}");

            let h = 1e-6;
            let [low, high] = [-h, h].map(|step| map.inverse(&d, phase + step, &now));
            let along = (high.position - low.position) / (2.0 * h);
            assert!((along - position.phase_derivative).length() < 1e-7);
            let along = (high.rotation - low.rotation) / (2.0 * h);
            assert!((along - rotation.phase_derivative).length() < 1e-7);
            for axis in DVec3::AXES {
                let [low, high] = [-h, h].map(|step| {
                    let rotation = DQuat::from_scaled_axis(axis * step);
                    let moved = Pose {
                        position: now.position + axis * step,
                        orientation: rotation * now.orientation,
                    };
                    map.inverse(&d, phase, &moved)
                });
                let column = (high.position - low.position) / (2.0 * h);
                assert!((column - position.jacobian * axis).length() < 1e-8);
                let column = (high.rotation - low.rotation) / (2.0 * h);
                assert!((column - rotation.jacobian * axis).length() < 1e-7);
            }
        }
    }
}

#[test]
fn too_few_frames_and_anchors_out_of_order_are_refused() {
    let [start, between, goal_frame] = anchors();
    let map = |anchors: &[Anchor]| FrameMap::new(anchors, goal(), true);
    assert_eq!(map(&[]).unwrap_err(), FrameMapError::AnchorCount(0));
    let many = [start; FRAME_CAPACITY + 1];
    assert_eq!(map(&many).unwrap_err(), FrameMapError::AnchorCount(FRAME_CAPACITY + 1));
    let error = map(&[start, goal_frame, between]).unwrap_err();
    assert_eq!(error, FrameMapError::PhasesTooClose(2));
    let late = Anchor { phase: f64::NAN, ..between };
    assert_eq!(map(&[start, late]).unwrap_err(), FrameMapError::PhasesTooClose(1));
    let three = map(&[start, between, goal_frame]).unwrap();
    assert!(three.transforms(&frames(0.0)[..2]).is_none());
    assert_eq!(three.frame_count(), 3);
}
