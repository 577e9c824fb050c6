//! Certifies a fitted policy: what can be proved of it, and what rollouts in the world show.

use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tprmp_model::skill_model::{Certificate, DemonstrationRollout, Manifold, Rollouts};
use tprmp_rmpflow::policy::canonical::frame_map::Canonical;
use tprmp_spatial::{MovingPose, Pose};

use crate::canonical::{CanonicalDemonstration, CanonicalSet};
use crate::certify::blocks::blocks;
use crate::certify::policy::{Body, LearnedPolicy};
use crate::certify::rollout::{Outcome, RolloutSpec, Target, follow};
use crate::demonstration::Demonstration;
use crate::skill::{Certification, Skill};

/// Step of the rollouts of demonstrations [s], that of a fast controller.
const STEP_S: f64 = 1e-3;
/// Every how many steps the way of a rollout is looked at for the nearest point.
const WAY_STEP: usize = 5;
/// A rollout stops once it is this much nearer to the goal than the tolerance.
const ARRIVED_FRACTION: f64 = 0.01;
/// Largest rotation vector of a random start [rad].
const START_ANGLE_MAX_RAD: f64 = 0.95 * std::f64::consts::PI;
/// The goal is at rest below this |M⁻¹∇Φ| [m/s² or rad/s²].
const GOAL_GRADIENT_MAX: f64 = 1e-6;

/// A start with frames: one rollout of the certificate.
struct Start {
    frames: Vec<MovingPose>,
    pose: Pose,
    goal: Pose,
}

/// Certifies a policy learned from demonstrations.
pub struct Certifier<'a> {
    skill: &'a Skill,
    demonstrations: &'a [Demonstration],
    set: &'a CanonicalSet,
    policy: &'a LearnedPolicy,
}

impl<'a> Certifier<'a> {
    /// A certifier.
    #[must_use]
    pub fn new(
        skill: &'a Skill,
        demonstrations: &'a [Demonstration],
        set: &'a CanonicalSet,
        policy: &'a LearnedPolicy,
    ) -> Self {
        Self { skill, demonstrations, set, policy }
    }

    fn settings(&self) -> &Certification {
        &self.skill.certification
    }

    /// Follows the policy from every demonstration's start, from rest, with its frames.
    #[must_use]
    pub fn follow_demonstrations(&self) -> Vec<DemonstrationRollout> {
        let pairs = self.demonstrations.par_iter().zip(&self.set.demonstrations);
        pairs.map(|(demonstration, canonical)| self.follow(demonstration, canonical).0).collect()
    }

    /// Follows the policy from a demonstration's start; the poses, one a millisecond, go with the
    /// figures.
    #[must_use]
    pub fn follow(
        &self,
        demonstration: &Demonstration,
        canonical: &CanonicalDemonstration,
    ) -> (DemonstrationRollout, Vec<Pose>) {
        let shown = &demonstration.poses[canonical.rest..];
        let duration_s = (shown.len() - 1) as f64 * demonstration.sampling_time_s;
        let steps = (self.settings().horizon_s.max(duration_s) / STEP_S).ceil() as usize + 1;
        let target = Target { goal: self.goal(&demonstration.goal_frame), arrived: None };
        let spec = self.spec(shown[0], STEP_S, steps);
        let frames = at_rest(&self.skill.frames(demonstration));
        let mut path = Vec::with_capacity(steps + 1);
        let mut policy = self.policy.instance();
        let outcome = follow(&mut policy, &frames, &target, &spec, |pose| path.push(*pose));
        let at = |time_s: f64| {
            let step = time_s / STEP_S;
            let (i, fraction) = (step.floor() as usize, step.fract());
            let last = path.len() - 1;
            let (a, b) = (path[i.min(last)], path[(i + 1).min(last)]);
            Pose {
                position: a.position.lerp(b.position, fraction),
                orientation: a.orientation.slerp(b.orientation, fraction),
            }
        };
        let (mut square_m2, mut square_rad2, mut square_path_m2) = (0.0, 0.0, 0.0);
        for (i, pose) in shown.iter().enumerate() {
            let here = at(i as f64 * demonstration.sampling_time_s);
            square_m2 += (here.position - pose.position).length_squared();
            square_rad2 += here.rotation_from(pose).length_squared();
            let way = path.iter().step_by(WAY_STEP);
            let nearest = way.map(|way| (way.position - pose.position).length_squared());
            square_path_m2 += nearest.fold(f64::INFINITY, f64::min);
        }
        let count = shown.len() as f64;
        let turns = if self.skill.manifold.has_orientation() { 1.0 } else { 0.0 };
        let figures = DemonstrationRollout {
            name: demonstration.name.clone(),
            goal_error_m: outcome.goal_error_m,
            goal_error_rad: outcome.goal_error_rad,
            tracking_rms_m: (square_m2 / count).sqrt(),
            path_rms_m: (square_path_m2 / count).sqrt(),
            tracking_rms_rad: (square_rad2 / count).sqrt() * turns,
        };
        (figures, path)
    }

    /// A rollout from rest.
    fn spec(&self, start: Pose, step_s: f64, steps: usize) -> RolloutSpec {
        let manifold = self.skill.manifold;
        RolloutSpec { manifold, start: Body::at_rest(start), step_s, steps }
    }

    /// The goal of the demonstrations where the goal frame is.
    fn goal(&self, goal_frame: &Pose) -> Pose {
        let map = &self.set.map;
        goal_frame.compose(&map.goal_frame().inverse().compose(&map.goal()))
    }

    /// The certificate. `demonstrations` are the rollouts from the demonstrated starts, `faults` are
    /// stretches of the valley that the fit left; `progress` is told after each rollout.
    #[must_use]
    pub fn certify(
        &self,
        demonstrations: &[DemonstrationRollout],
        faults: u32,
        seed: u64,
        progress: &mut dyn FnMut(),
    ) -> Certificate {
        let settings = self.settings();
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // A stream of its own: the random points of the fit do not move the starts.
        random.set_stream(2);
        let shown = self.starts(settings.random_starts, false, &mut random);
        let displaced = self.starts(settings.displaced_starts, true, &mut random);
        let goal = self.goal(&self.demonstrations[0].goal_frame);
        let frames = at_rest(&self.skill.frames(&self.demonstrations[0]));
        let mut certificate = Certificate {
            failures: Vec::new(),
            blocks: blocks(self.policy.policy(), &frames, &goal),
            demonstrated_frames: self.try_out(&shown, progress),
            displaced_frames: self.try_out(&displaced, progress),
            step_s: settings.step_s,
        };
        certificate.failures = self.failures(&certificate, demonstrations, faults);
        certificate
    }

    /// Random starts around demonstrated points, with the frames of their demonstration or with
    /// displaced ones.
    fn starts(&self, count: u32, displaced: bool, random: &mut impl Rng) -> Vec<Start> {
        let map = &self.set.map;
        (0..count)
            .map(|_| {
                let index = random.random_range(0..self.demonstrations.len());
                let mut frames = self.skill.frames(&self.demonstrations[index]);
                let shown = &self.set.demonstrations[index];
                let sample = random.random_range(0..shown.position.points.len());
                let radius = self.settings().random_start_radius;
                let [linear, angular] = self.set.scales.map(|scale| radius / scale);
                let mut near = Canonical {
                    position: shown.position.points[sample] + self.in_ball(linear, random),
                    rotation: DVec3::ZERO,
                };
                let phase = shown.phases[sample][0];
                if self.skill.manifold.has_orientation() {
                    near.rotation = (shown.rotation.points[sample] + in_ball(angular, random))
                        .clamp_length_max(START_ANGLE_MAX_RAD);
                }
                if displaced {
                    frames.iter_mut().for_each(|frame| *frame = self.displaced(frame, random));
                }
                let moved = at_rest(&frames);
                let transforms = map.transforms(&moved).expect("they are the skill's frames");
                let goal_frame =
                    frames[usize::from(self.skill.goal_frame != self.skill.start_frame)];
                let pose = map.forward(&transforms, phase, &near);
                let pose = if self.skill.manifold == Manifold::R3S3 {
                    pose
                } else {
                    Pose { orientation: DQuat::IDENTITY, ..pose }
                };
                Start { pose, goal: self.goal(&goal_frame), frames: moved }
            })
            .collect()
    }

    fn displaced(&self, frame: &Pose, random: &mut impl Rng) -> Pose {
        let settings = self.settings();
        let points = self.set.map.anchors().iter().map(|anchor| anchor.point);
        let way =
            points.map(|point| (point - self.set.start.position).length()).fold(0.0, f64::max);
        let position =
            frame.position + self.in_ball(settings.frame_translation_fraction * way, random);
        let turn = if self.skill.manifold == Manifold::R2 {
            DVec3::Z * (settings.frame_rotation_rad * random.random_range(-1.0..=1.0))
        } else {
            in_ball(settings.frame_rotation_rad, random)
        };
        Pose { position, orientation: DQuat::from_scaled_axis(turn) * frame.orientation }
    }

    /// A point in a ball, or a disc in the plane.
    fn in_ball(&self, radius: f64, random: &mut impl Rng) -> DVec3 {
        let mut point = in_ball(radius, random);
        if self.skill.manifold == Manifold::R2 {
            point.z = 0.0;
        }
        point
    }

    fn try_out(&self, starts: &[Start], progress: &mut dyn FnMut()) -> Rollouts {
        let settings = self.settings();
        let tolerance = [settings.goal_tolerance_m, settings.goal_tolerance_rad];
        let try_one = |start: &Start| -> Outcome {
            let arrived = Some(tolerance.map(|t| t * ARRIVED_FRACTION));
            let target = Target { goal: start.goal, arrived };
            let steps = (settings.horizon_s / settings.step_s).ceil() as usize;
            let spec = self.spec(start.pose, settings.step_s, steps);
            follow(&mut self.policy.instance(), &start.frames, &target, &spec, |_| {})
        };
        let mut outcomes: Vec<Outcome> = Vec::with_capacity(starts.len());
        for some in starts.chunks(16) {
            outcomes.par_extend(some.par_iter().map(try_one));
            progress();
        }
        let most = |f: fn(&Outcome) -> f64| {
            // What is not a number counts as infinite.
            let values = outcomes.iter().map(f);
            values.map(|x| if x.is_nan() { f64::INFINITY } else { x }).fold(0.0, f64::max)
        };
        let energy_at_start = most(|o| o.energy_at_start).max(f64::MIN_POSITIVE);
        let reached = outcomes
            .iter()
            .filter(|o| o.goal_error_m <= tolerance[0] && o.goal_error_rad <= tolerance[1]);
        Rollouts {
            starts: starts.len() as u32,
            reached: reached.count() as u32,
            goal_error_max_m: most(|o| o.goal_error_m),
            goal_error_max_rad: most(|o| o.goal_error_rad),
            energy_rise_max: most(|o| o.energy_rise_max) / energy_at_start,
        }
    }

    fn failures(
        &self,
        certificate: &Certificate,
        demonstrations: &[DemonstrationRollout],
        faults: u32,
    ) -> Vec<String> {
        let settings = self.settings();
        let mut failures = Vec::new();
        for row in demonstrations {
            let reached = row.goal_error_m <= settings.goal_tolerance_m
                && row.goal_error_rad <= settings.goal_tolerance_rad;
            if !reached {
                failures.push(format!(
                    "from the start of demonstration `{}` it ends {} and {:.2}° from the goal",
                    row.name,
                    length(row.goal_error_m, 2),
                    row.goal_error_rad.to_degrees()
                ));
            }
        }
        for block in &certificate.blocks {
            let name = &block.name;
            let least = block.metric_eigenvalue_min;
            if !(least > 0.0 && block.metric_eigenvalue_max.is_finite()) {
                failures.push(format!("the {name} metric is not positive definite ({least:.2e})"));
            }
            if block.goal_gradient.is_nan() || block.goal_gradient > GOAL_GRADIENT_MAX {
                failures.push(format!(
                    "the {name} is not at rest at the goal (|M⁻¹∇Φ| = {:.2e})",
                    block.goal_gradient
                ));
            }
            if let Some(valley) = &block.valley {
                let least = valley.stiffness_min_1_s2;
                if least.is_nan() || least <= 0.0 {
                    failures.push(format!(
                        "the {name} potential has no lowest point at some phase (stiffness \
                         {least:.2e}/s²)"
                    ));
                }
            }
            if block.goal_hessian_min_1_s2.is_nan() || block.goal_hessian_min_1_s2 <= 0.0 {
                failures.push(format!(
                    "the goal is no minimum of the {name} potential (Hessian {:.2e}/s²)",
                    block.goal_hessian_min_1_s2
                ));
            }
        }
        if faults > 0 {
            failures.push(format!(
                "the potential does not fall towards the goal on {faults} stretches of its valley"
            ));
        }
        for (rollouts, of) in [
            (&certificate.demonstrated_frames, "around the demonstrations"),
            (&certificate.displaced_frames, "with displaced frames"),
        ] {
            if rollouts.reached < rollouts.starts {
                failures.push(format!(
                    "{} of {} random starts {of} do not reach the goal: the worst ends {} and \
                     {:.1}° away",
                    rollouts.starts - rollouts.reached,
                    rollouts.starts,
                    length(rollouts.goal_error_max_m, 1),
                    rollouts.goal_error_max_rad.to_degrees()
                ));
            }
            if rollouts.energy_rise_max > settings.energy_rise_max {
                failures.push(format!(
                    "the energy rises by a fraction of {:.1e} in a step, from random starts {of}",
                    rollouts.energy_rise_max
                ));
            }
        }
        failures
    }
}

/// Frames that do not move.
fn at_rest(frames: &[Pose]) -> Vec<MovingPose> {
    frames.iter().copied().map(MovingPose::at_rest).collect()
}

/// A length in words; what diverged has no use for its digits.
fn length(metres: f64, decimals: usize) -> String {
    if metres < 1e4 { format!("{:.decimals$} mm", metres * 1e3) } else { format!("{metres:.0e} m") }
}

/// A point in a ball, evenly distributed.
fn in_ball(radius: f64, random: &mut impl Rng) -> DVec3 {
    // One try in two hits; 64 misses in a row do not happen.
    for _ in 0..64 {
        let point = DVec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
        if point.length() <= 1.0 {
            return point * radius;
        }
    }
    DVec3::ZERO
}
