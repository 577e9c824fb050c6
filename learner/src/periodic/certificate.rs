//! Certifies what goes round: rollouts from anywhere come to the same limit cycle.

use std::ops::ControlFlow::{self, Break, Continue};

use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tprmp_model::skill_model::{
    Certificate, CycleCertificate, DemonstrationRollout, Manifold, Rollouts, blocks,
};
use tprmp_spatial::{MovingPose, Pose};

use crate::canonical::ANGLE_MAX_RAD;
use crate::certify::policy::{Body, DesiredMotion, LearnedPolicy, PolicyInstance};
use crate::certify::rollout::{Environment, RolloutSpec, roll_out};
use crate::certify::{beside, cycle_failures, in_ball};
use crate::demonstration::Demonstration;
use crate::periodic::rounds::Rounds;
use crate::skill::Skill;

/// Rollouts go round so many times: in the first rounds they come to the cycle.
const ROUNDS: f64 = 10.0;
/// Places of a round at which it is compared with the one before.
const PLACES: usize = 8;
/// A recording is compared at so many of its samples.
const COMPARED: usize = 300;

/// Certifies a policy learned from rounds.
pub(super) struct CycleCertifier<'a> {
    pub skill: &'a Skill,
    pub demonstrations: &'a [Demonstration],
    pub rounds: &'a Rounds,
    pub policy: &'a LearnedPolicy,
}

/// A start, with its frame.
struct Start {
    frame: Pose,
    pose: Pose,
}

/// Pose, seen from the frame, and time \[s\].
type Passed = (Pose, f64);

/// How a rollout went.
struct Went {
    /// Pose, seen from the frame, and time at each place that was passed, from a whole number of rounds on.
    passed: Vec<Passed>,
    /// Poses of the last round, seen from the frame.
    last_round: Vec<Pose>,
    /// Largest rise of V in a step.
    energy_rise_max: f64,
    /// Speed at the end [m/s].
    speed_m_s: f64,
}

impl Went {
    /// The places of the last round, and those of the round before; `None` when it did not go round twice.
    fn returns(&self) -> Option<[&[Passed]; 2]> {
        let end = self.passed.len().checked_sub(1)? / PLACES * PLACES + 1;
        let last = self.passed.get(end.checked_sub(PLACES + 1)?..end)?;
        let before = self.passed.get(end.checked_sub(2 * PLACES + 1)?..end - PLACES)?;
        Some([last, before])
    }

    /// How far apart the last two rounds are [m, rad].
    fn return_error(&self) -> [f64; 2] {
        self.returns().map_or([f64::INFINITY; 2], |[last, before]| apart(last, before))
    }

    /// How far the last round is from that of another rollout [m, rad].
    fn from(&self, other: &Self) -> [f64; 2] {
        match (self.returns(), other.returns()) {
            (Some([own, _]), Some([others, _])) => apart(own, others),
            _ => [f64::INFINITY; 2],
        }
    }

    /// How long the last round took \[s\].
    fn period_s(&self) -> f64 {
        self.returns().map_or(0.0, |[last, _]| last[PLACES].1 - last[0].1)
    }
}

/// Largest distance and angle between poses [m, rad].
fn apart(a: &[Passed], b: &[Passed]) -> [f64; 2] {
    a.iter().zip(b).fold([0.0, 0.0], |[metres, radians]: [f64; 2], ((a, _), (b, _))| {
        let (position, rotation) =
            ((a.position - b.position).length(), a.rotation_from(b).length());
        [metres.max(position), radians.max(rotation)]
    })
}

/// A frame at rest, and a watch on the way round.
struct Watch {
    frames: [MovingPose; 1],
    rotates: bool,
    /// Rounds and phase, pose seen from the frame and time of each step.
    steps: Vec<(f64, Pose, f64)>,
    energy: Option<f64>,
    energy_rise_max: f64,
    speed_m_s: f64,
}

impl Environment<PolicyInstance<'_>> for Watch {
    fn frames(&self) -> &[MovingPose] {
        &self.frames
    }

    fn observe(&mut self, body: &Body, _policy: &mut PolicyInstance<'_>) -> ControlFlow<()> {
        self.speed_m_s = body.velocity.linear.length();
        Continue(())
    }

    fn act(
        &mut self,
        body: &Body,
        desired: &mut DesiredMotion,
        policy: &mut PolicyInstance<'_>,
    ) -> ControlFlow<()> {
        if let Some(before) = self.energy.replace(desired.energy) {
            self.energy_rise_max = self.energy_rise_max.max(desired.energy - before);
        }
        let Some(progress) = policy.progress() else { return Break(()) };
        let mut pose = self.frames[0].pose.inverse().compose(&body.pose);
        if !self.rotates {
            pose.orientation = DQuat::IDENTITY;
        }
        self.steps.push((progress, pose, body.time_s));
        let begun = self.steps[0].0;
        if progress > begun.ceil() + ROUNDS { Break(()) } else { Continue(()) }
    }
}

impl CycleCertifier<'_> {
    /// Longest rollout \[s\].
    fn horizon_s(&self) -> f64 {
        (1.5 * (ROUNDS + 1.0) * self.rounds.period_s).max(self.skill.certification.horizon_s)
    }

    fn follow(&self, start: &Start, step_s: f64) -> Went {
        let manifold = self.skill.manifold;
        let mut watch = Watch {
            frames: [MovingPose::at_rest(start.frame)],
            rotates: manifold.has_orientation(),
            steps: Vec::new(),
            energy: None,
            energy_rise_max: 0.0,
            speed_m_s: 0.0,
        };
        let steps = (self.horizon_s() / step_s).ceil() as usize;
        let spec = RolloutSpec { manifold, start: Body::at_rest(start.pose), step_s, steps };
        roll_out(&mut self.policy.instance(), &mut watch, &spec);
        let Watch { steps, energy_rise_max, speed_m_s, .. } = watch;
        let end = steps.last().map_or(0.0, |(progress, ..)| *progress);
        let last_round = steps.iter().filter(|(progress, ..)| *progress >= end - 1.0);
        Went {
            last_round: last_round.map(|(_, pose, _)| *pose).collect(),
            passed: passed(&steps),
            energy_rise_max,
            speed_m_s,
        }
    }

    /// Follows the policy from where each demonstration begins to go round, from rest, with its frame. The figures of
    /// the end are those of the last round against the one before.
    pub(super) fn follow_demonstrations(&self) -> (Vec<DemonstrationRollout>, CycleCertificate) {
        let step_s = self.skill.certification.demonstration_step_s;
        let indices = 0..self.demonstrations.len();
        let all: Vec<(DemonstrationRollout, Went)> = indices
            .into_par_iter()
            .map(|i| {
                let demonstration = &self.demonstrations[i];
                let own = self.rounds.all.iter().filter(|round| round.demonstration == i);
                let own: Vec<_> = own.collect();
                let pose = demonstration.poses[own[0].samples.start];
                let went = self.follow(&Start { frame: demonstration.goal_frame, pose }, step_s);
                let first = own[0].samples.start;
                let end = own[own.len() - 1].samples.end.min(demonstration.poses.len());
                let durations = own.iter().map(|round| round.duration_s).sum::<f64>();
                let seen = demonstration.goal_frame.inverse();
                let recorded: Vec<Pose> = demonstration.poses[first..end]
                    .iter()
                    .step_by(((end - first) / COMPARED).max(1))
                    .map(|pose| seen.compose(pose))
                    .collect();
                let row = self.row(i, &went, &recorded, durations / own.len() as f64);
                (row, went)
            })
            .collect();
        let cycle = self.cycle(&all);
        (all.into_iter().map(|(row, _)| row).collect(), cycle)
    }

    fn row(
        &self,
        i: usize,
        went: &Went,
        recorded: &[Pose],
        duration_s: f64,
    ) -> DemonstrationRollout {
        let rotates = if self.skill.manifold.has_orientation() { 1.0 } else { 0.0 };
        let [path_m, path_rad] = self.beside(recorded, went);
        let [mean_m, mean_rad] = self.beside(&self.rounds.mean_poses(), went);
        let [metres, radians] = went.return_error();
        DemonstrationRollout {
            name: self.demonstrations[i].name.clone(),
            goal_error_m: metres,
            goal_error_rad: radians * rotates,
            tracking_rms_m: mean_m,
            tracking_rms_rad: mean_rad * rotates,
            path_rms_m: path_m,
            path_rms_rad: path_rad * rotates,
            end_error_m: metres,
            end_error_rad: radians * rotates,
            predicted_rms_m: 0.0,
            predicted_rms_rad: 0.0,
            execution_s: went.period_s(),
            duration_s,
            recorded_s: Vec::new(),
        }
    }

    /// Root of the mean square distance of poses, seen from the frame, from the last round [m, rad].
    fn beside(&self, poses: &[Pose], went: &Went) -> [f64; 2] {
        if went.last_round.is_empty() {
            return [f64::INFINITY; 2];
        }
        beside(poses, &went.last_round, self.rounds.scales)
    }

    fn cycle(&self, all: &[(DemonstrationRollout, Went)]) -> CycleCertificate {
        let (first, went) = &all[0];
        let rotates = if self.skill.manifold.has_orientation() { 1.0 } else { 0.0 };
        let mut most = [0.0_f64; 2];
        for pose in self.rounds.mean_poses() {
            let here = self.beside(&[pose], went);
            most = [most[0].max(here[0]), most[1].max(here[1])];
        }
        let returns = |of: fn(&DemonstrationRollout) -> f64| {
            all.iter().map(|(row, _)| of(row)).fold(0.0, f64::max)
        };
        CycleCertificate {
            period_s: went.period_s(),
            demonstrated_period_s: self.rounds.period_s,
            rounds: self.rounds.counts.clone(),
            beside_rms_m: first.tracking_rms_m,
            beside_rms_rad: first.tracking_rms_rad,
            beside_max_m: most[0],
            beside_max_rad: most[1] * rotates,
            return_max_m: returns(|row| row.goal_error_m),
            return_max_rad: returns(|row| row.goal_error_rad),
        }
    }

    /// The certificate. `rows` and `cycle` are those of the demonstrated starts, `faults` are stretches of the valley
    /// that the fit left; `fall` is by how much V falls in a round.
    pub(super) fn certify(
        &self,
        rows: &[DemonstrationRollout],
        cycle: CycleCertificate,
        (faults, fall): (u32, f64),
        seed: u64,
    ) -> Certificate {
        let settings = &self.skill.certification;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // A stream of its own: the random points of the fit do not move the starts.
        random.set_stream(2);
        let around = self.draw(settings.random_starts, false, &mut random);
        let displaced = self.draw(settings.displaced_starts, true, &mut random);
        let demonstration = &self.demonstrations[0];
        let frames = [MovingPose::at_rest(demonstration.goal_frame)];
        let on_mean = self.rounds.mean_poses()[0];
        let pose = demonstration.goal_frame.compose(&on_mean);
        let reference =
            self.follow(&Start { frame: demonstration.goal_frame, pose }, settings.step_s);
        let mut certificate = Certificate {
            failures: Vec::new(),
            blocks: blocks(self.policy.policy(), &frames, &self.rounds.centre),
            demonstrated_frames: self.roll_out(&around, &reference, fall),
            displaced_frames: self.roll_out(&displaced, &reference, fall),
            step_s: settings.step_s,
            cycle: Some(cycle),
        };
        certificate.failures = cycle_failures(settings, &certificate, rows, faults);
        certificate
    }

    /// Rollouts that have to come to the cycle of `reference`.
    fn roll_out(&self, starts: &[Start], reference: &Went, fall: f64) -> Rollouts {
        let settings = &self.skill.certification;
        let tolerance = [settings.goal_tolerance_m, settings.goal_tolerance_rad];
        let all: Vec<Went> =
            starts.par_iter().map(|start| self.follow(start, settings.step_s)).collect();
        let rotates = if self.skill.manifold.has_orientation() { 1.0 } else { 0.0 };
        let error = |went: &Went| {
            let (own, others) = (went.return_error(), went.from(reference));
            [own[0].max(others[0]), own[1].max(others[1]) * rotates]
        };
        let errors: Vec<[f64; 2]> = all.iter().map(error).collect();
        let reached = |[m, rad]: &&[f64; 2]| *m <= tolerance[0] && *rad <= tolerance[1];
        let most = |i: usize| errors.iter().map(|error| error[i]).fold(0.0, f64::max);
        let moving = errors.iter().zip(&all);
        let moving =
            moving.filter(|(error, went)| !reached(error) && went.speed_m_s > tolerance[0]);
        let rise = all.iter().map(|went| went.energy_rise_max).fold(0.0, f64::max);
        Rollouts {
            starts: starts.len() as u32,
            reached: errors.iter().filter(reached).count() as u32,
            goal_error_max_m: most(0),
            goal_error_max_rad: most(1),
            energy_rise_max: rise / fall.max(f64::MIN_POSITIVE),
            on_their_way: moving.count() as u32,
        }
    }

    /// Random starts around points of the rounds, with the frame of their demonstration or with a displaced one.
    fn draw(&self, count: u32, displaced: bool, random: &mut impl Rng) -> Vec<Start> {
        (0..count).map(|_| self.draw_one(displaced, random)).collect()
    }

    fn draw_one(&self, displaced: bool, random: &mut impl Rng) -> Start {
        let (skill, rounds) = (self.skill, self.rounds);
        let settings = &skill.certification;
        let planar = skill.manifold == Manifold::R2;
        let flat = |v: DVec3| if planar { DVec3::new(v.x, v.y, 0.0) } else { v };
        let round = &rounds.all[random.random_range(0..rounds.all.len())];
        let sample = random.random_range(0..rounds.phases.len());
        let [linear, angular] = rounds.scales.map(|scale| settings.random_start_radius / scale);
        let mut pose = Pose {
            position: round.position.points[sample] + flat(in_ball(linear, random)),
            orientation: DQuat::IDENTITY,
        };
        if skill.manifold.has_orientation() {
            let rotation = round.rotation.points[sample] + in_ball(angular, random);
            let rotation = DQuat::from_scaled_axis(rotation.clamp_length_max(ANGLE_MAX_RAD));
            pose.orientation = rounds.centre.orientation * rotation;
        }
        let mut frame = self.demonstrations[round.demonstration].goal_frame;
        if displaced {
            let from_centre = (rounds.mean[0][0] - rounds.centre.position).length();
            let radius = settings.frame_translation_fraction * from_centre;
            frame.position += flat(in_ball(radius, random));
            let rotation = match planar {
                true => DVec3::Z * (settings.frame_rotation_rad * random.random_range(-1.0..=1.0)),
                false => in_ball(settings.frame_rotation_rad, random),
            };
            frame.orientation = DQuat::from_scaled_axis(rotation) * frame.orientation;
        }
        let mut start = frame.compose(&pose);
        if planar {
            start.orientation = DQuat::IDENTITY;
        }
        Start { frame, pose: start }
    }
}

/// Pose and time where each place was passed for the first time, from a whole number of rounds on.
fn passed(steps: &[(f64, Pose, f64)]) -> Vec<Passed> {
    let Some((begun, ..)) = steps.first() else { return Vec::new() };
    let (mut passed, mut next) = (Vec::new(), begun.ceil());
    for pair in steps.windows(2) {
        let [(before, a, a_s), (after, b, b_s)] = pair else { continue };
        while next > *before && next <= *after {
            let fraction = (next - before) / (after - before);
            passed.push((a.interpolate(b, fraction), a_s + fraction * (b_s - a_s)));
            next += 1.0 / PLACES as f64;
        }
    }
    passed
}
