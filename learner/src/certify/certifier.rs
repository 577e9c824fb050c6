//! Certifies a fitted policy: what can be proved of it, and what rollouts in the world show.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tprmp_model::skill_model::{Certificate, DemonstrationRollout, Rollouts, blocks};
use tprmp_spatial::Pose;

use crate::alignment::Alignment;
use crate::canonical::CanonicalSet;
use crate::canonical::agreement::predicted;
use crate::certify::failures::failures;
use crate::certify::policy::{Body, LearnedPolicy};
use crate::certify::rollout::{Outcome, RolloutSpec, Target, follow};
use crate::certify::starts::{Start, Starts, at_rest};
use crate::demonstration::Demonstration;
use crate::skill::Skill;

/// Every how many steps of a rollout a demonstrated point is compared with it: at a millisecond a step, a
/// Of longer paths no more than about so many steps are.
const PATH_MAX: usize = 6000;
/// Of longer recordings every few samples are compared, so that no more than these are.
const POSES_MAX: usize = 1500;
/// tool moves a few millimetres in between.
const PATH_STRIDE: usize = 5;

/// A rollout may last so many times as long as the demonstrations, whatever the skill file says.
const DURATIONS: f64 = 3.0;
/// A rollout has arrived once it stays this near to its end \[ŷ\]: a hundredth of the skill's span.
const SETTLED: f64 = 0.0275;

/// Certifies a policy learned from demonstrations.
pub struct Certifier<'a> {
    skill: &'a Skill,
    policy: &'a LearnedPolicy,
    starts: Starts<'a>,
    /// Longest rollout \[s\]: no shorter than the skill needs.
    horizon_s: f64,
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
        let horizon_s =
            skill.certification.horizon_s.max(DURATIONS * demonstrations[0].duration_s());
        Self { skill, policy, starts: Starts { skill, demonstrations, set }, horizon_s }
    }

    /// Follows the policy from every demonstration's start, from rest, with its frames. What the demonstrations
    /// show is measured against the recordings, what the common time says against the aligned ones.
    #[must_use]
    pub fn follow_demonstrations(
        &self,
        recorded: &[Demonstration],
        alignments: &[Alignment],
    ) -> Vec<DemonstrationRollout> {
        let predicted = predicted(self.skill, self.starts.demonstrations, self.starts.set);
        let all = self.starts.demonstrations.par_iter().zip(recorded).zip(alignments);
        let rows =
            all.map(|((aligned, recorded), alignment)| self.follow(aligned, recorded, alignment));
        let mut rows: Vec<DemonstrationRollout> = rows.collect();
        for (row, [metres, radians]) in rows.iter_mut().zip(predicted) {
            (row.predicted_rms_m, row.predicted_rms_rad) = (metres, radians);
        }
        rows
    }

    fn follow(
        &self,
        aligned: &Demonstration,
        recorded: &Demonstration,
        alignment: &Alignment,
    ) -> DemonstrationRollout {
        let settings = &self.skill.certification;
        let step_s = settings.demonstration_step_s;
        let steps = (self.horizon_s.max(aligned.duration_s()) / step_s).ceil() as usize + 1;
        let target = Target { goal: self.starts.goal(&aligned.goal_frame), arrived: None };
        let spec = self.spec(aligned.poses[0], step_s, steps);
        let frames = at_rest(&self.skill.frames(aligned));
        let mut path = Vec::with_capacity(steps + 1);
        let mut policy = self.policy.instance();
        let outcome = follow(&mut policy, &frames, &target, &spec, |pose| path.push(*pose));
        let scales = self.starts.set.scales;
        let (tracking, along) = (
            in_time(aligned, &path, step_s),
            beside(&recorded.poses[alignment.moving()], &path, scales),
        );
        let rotates = if self.skill.manifold.has_orientation() { 1.0 } else { 0.0 };
        let (end, demonstrated) = (path[path.len() - 1], aligned.poses[aligned.poses.len() - 1]);
        DemonstrationRollout {
            name: aligned.name.clone(),
            goal_error_m: outcome.goal_error_m,
            goal_error_rad: outcome.goal_error_rad,
            tracking_rms_m: tracking[0],
            tracking_rms_rad: tracking[1] * rotates,
            path_rms_m: along[0],
            path_rms_rad: along[1] * rotates,
            end_error_m: (end.position - demonstrated.position).length(),
            end_error_rad: end.rotation_from(&demonstrated).length() * rotates,
            predicted_rms_m: 0.0,
            predicted_rms_rad: 0.0,
            execution_s: settled(&path, scales) as f64 * step_s,
            duration_s: alignment.duration_s,
            recorded_s: alignment.table_s(),
        }
    }

    /// A rollout from rest.
    fn spec(&self, start: Pose, step_s: f64, steps: usize) -> RolloutSpec {
        let manifold = self.skill.manifold;
        RolloutSpec { manifold, start: Body::at_rest(start), step_s, steps }
    }

    /// The certificate. `demonstrations` are the rollouts from the demonstrated starts, `faults` are
    /// stretches of the valley that the fit left; `progress` hears of each batch of rollouts.
    #[must_use]
    pub fn certify(
        &self,
        demonstrations: &[DemonstrationRollout],
        faults: u32,
        seed: u64,
        progress: &mut dyn FnMut(),
    ) -> Certificate {
        let settings = &self.skill.certification;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // A stream of its own: the random points of the fit do not move the starts.
        random.set_stream(2);
        let around = self.starts.draw(settings.random_starts, false, &mut random);
        let displaced = self.starts.draw(settings.displaced_starts, true, &mut random);
        let first = &self.starts.demonstrations[0];
        let frames = at_rest(&self.skill.frames(first));
        let goal = self.starts.goal(&first.goal_frame);
        let mut certificate = Certificate {
            failures: Vec::new(),
            blocks: blocks(self.policy.policy(), &frames, &goal),
            demonstrated_frames: self.roll_out(&around, progress),
            displaced_frames: self.roll_out(&displaced, progress),
            step_s: settings.step_s,
            cycle: None,
        };
        certificate.failures = failures(settings, &certificate, demonstrations, faults);
        certificate
    }

    fn roll_out(&self, starts: &[Start], progress: &mut dyn FnMut()) -> Rollouts {
        let settings = &self.skill.certification;
        let tolerance = [settings.goal_tolerance_m, settings.goal_tolerance_rad];
        let one = |start: &Start| -> Outcome {
            let arrived = Some(tolerance.map(|t| t * settings.arrival_fraction));
            let target = Target { goal: start.goal, arrived };
            let steps = (self.horizon_s / settings.step_s).ceil() as usize;
            let spec = self.spec(start.pose, settings.step_s, steps);
            follow(&mut self.policy.instance(), &start.frames, &target, &spec, |_| {})
        };
        let mut outcomes: Vec<Outcome> = Vec::with_capacity(starts.len());
        for some in starts.chunks(16) {
            outcomes.par_extend(some.par_iter().map(one));
            progress();
        }
        let most = |f: fn(&Outcome) -> f64| {
            // What is not a number counts as infinite.
            let values = outcomes.iter().map(f);
            values.map(|x| if x.is_nan() { f64::INFINITY } else { x }).fold(0.0, f64::max)
        };
        let energy_at_start = most(|o| o.energy_at_start).max(f64::MIN_POSITIVE);
        let is_there =
            |o: &&Outcome| o.goal_error_m <= tolerance[0] && o.goal_error_rad <= tolerance[1];
        let reached = outcomes.iter().filter(is_there);
        let moves = |o: &&Outcome| o.speed_m_s > tolerance[0] && !is_there(o);
        Rollouts {
            starts: starts.len() as u32,
            reached: reached.count() as u32,
            goal_error_max_m: most(|o| o.goal_error_m),
            goal_error_max_rad: most(|o| o.goal_error_rad),
            energy_rise_max: most(|o| o.energy_rise_max) / energy_at_start,
            on_their_way: outcomes.iter().filter(moves).count() as u32,
        }
    }
}

/// Root of the mean square distance and angle of a path to a demonstration at the same times [m, rad].
fn in_time(demonstration: &Demonstration, path: &[Pose], step_s: f64) -> [f64; 2] {
    let last = path.len() - 1;
    let (mut metres, mut radians) = (0.0, 0.0);
    for (i, pose) in demonstration.poses.iter().enumerate() {
        let step = i as f64 * demonstration.sampling_time_s / step_s;
        let (k, fraction) = (step.floor() as usize, step.fract());
        let here = path[k.min(last)].interpolate(&path[(k + 1).min(last)], fraction);
        metres += (here.position - pose.position).length_squared();
        radians += here.rotation_from(pose).length_squared();
    }
    let count = demonstration.poses.len() as f64;
    [(metres / count).sqrt(), (radians / count).sqrt()]
}

/// Root of the mean square distance of poses to a path, whatever the time; and of the angle, where position
/// and angle together are nearest [m, rad].
pub(crate) fn beside(poses: &[Pose], path: &[Pose], scales: [f64; 2]) -> [f64; 2] {
    let path: Vec<&Pose> = path.iter().step_by(PATH_STRIDE.max(path.len() / PATH_MAX)).collect();
    let stride = poses.len().div_ceil(POSES_MAX).max(1);
    let count = poses.len().div_ceil(stride) as f64;
    let (mut metres, mut radians) = (0.0, 0.0);
    let mut last = 0;
    for pose in poses.iter().step_by(stride) {
        let (mut nearest, mut joint, mut angle) = (f64::INFINITY, f64::INFINITY, 0.0);
        // Where the pose before was nearest, few others are nearer.
        for i in std::iter::once(last).chain(0..path.len()) {
            let apart = (path[i].position - pose.position).length_squared();
            nearest = nearest.min(apart);
            let apart = apart * scales[0] * scales[0];
            if apart < joint {
                let turned = path[i].rotation_from(pose).length_squared();
                let both = apart + turned * scales[1] * scales[1];
                if both < joint {
                    (joint, angle, last) = (both, turned, i);
                }
            }
        }
        metres += nearest;
        radians += angle;
    }
    [(metres / count).sqrt(), (radians / count).sqrt()]
}

/// The step from which a path stays near its end.
fn settled(path: &[Pose], scales: [f64; 2]) -> usize {
    let end = path[path.len() - 1];
    let far = |pose: &Pose| {
        let metres = (pose.position - end.position).length() * scales[0];
        metres.hypot(pose.rotation_from(&end).length() * scales[1]) > SETTLED
    };
    path.iter().rposition(far).map_or(0, |i| i + 1)
}
