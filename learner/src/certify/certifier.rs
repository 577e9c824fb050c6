//! Certifies a fitted policy: what can be proved of it, and what rollouts in the world show.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tprmp_model::skill_model::{Certificate, DemonstrationRollout, Rollouts, blocks};
use tprmp_spatial::Pose;

use crate::canonical::CanonicalSet;
use crate::certify::failures::failures;
use crate::certify::policy::{Body, LearnedPolicy};
use crate::certify::rollout::{Outcome, RolloutSpec, Target, follow};
use crate::certify::starts::{Start, Starts, at_rest};
use crate::demonstration::Demonstration;
use crate::skill::Skill;

/// Every how many steps of a rollout a demonstrated point is compared with it: at a millisecond a step, a
/// tool moves a few millimetres in between.
const PATH_STRIDE: usize = 5;

/// Certifies a policy learned from demonstrations.
pub struct Certifier<'a> {
    skill: &'a Skill,
    policy: &'a LearnedPolicy,
    starts: Starts<'a>,
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
        Self { skill, policy, starts: Starts { skill, demonstrations, set } }
    }

    /// Follows the policy from every demonstration's start, from rest, with its frames.
    #[must_use]
    pub fn follow_demonstrations(&self) -> Vec<DemonstrationRollout> {
        self.starts.demonstrations.par_iter().map(|one| self.follow(one)).collect()
    }

    fn follow(&self, demonstration: &Demonstration) -> DemonstrationRollout {
        let settings = &self.skill.certification;
        let step_s = settings.demonstration_step_s;
        let demonstrated = &demonstration.poses;
        let duration_s = (demonstrated.len() - 1) as f64 * demonstration.sampling_time_s;
        let steps = (settings.horizon_s.max(duration_s) / step_s).ceil() as usize + 1;
        let target = Target { goal: self.starts.goal(&demonstration.goal_frame), arrived: None };
        let spec = self.spec(demonstrated[0], step_s, steps);
        let frames = at_rest(&self.skill.frames(demonstration));
        let mut path = Vec::with_capacity(steps + 1);
        let mut policy = self.policy.instance();
        let outcome = follow(&mut policy, &frames, &target, &spec, |pose| path.push(*pose));
        let at = |time_s: f64| {
            let step = time_s / step_s;
            let (i, fraction) = (step.floor() as usize, step.fract());
            let last = path.len() - 1;
            let (a, b) = (path[i.min(last)], path[(i + 1).min(last)]);
            a.interpolate(&b, fraction)
        };
        let (mut square_m2, mut square_rad2, mut square_path_m2) = (0.0, 0.0, 0.0);
        for (i, pose) in demonstrated.iter().enumerate() {
            let here = at(i as f64 * demonstration.sampling_time_s);
            square_m2 += (here.position - pose.position).length_squared();
            square_rad2 += here.rotation_from(pose).length_squared();
            let some = path.iter().step_by(PATH_STRIDE);
            let squares = some.map(|on_path| (on_path.position - pose.position).length_squared());
            square_path_m2 += squares.fold(f64::INFINITY, f64::min);
        }
        let count = demonstrated.len() as f64;
        let rotates = if self.skill.manifold.has_orientation() { 1.0 } else { 0.0 };
        DemonstrationRollout {
            name: demonstration.name.clone(),
            goal_error_m: outcome.goal_error_m,
            goal_error_rad: outcome.goal_error_rad,
            tracking_rms_m: (square_m2 / count).sqrt(),
            path_rms_m: (square_path_m2 / count).sqrt(),
            tracking_rms_rad: (square_rad2 / count).sqrt() * rotates,
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
            let steps = (settings.horizon_s / settings.step_s).ceil() as usize;
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
}
