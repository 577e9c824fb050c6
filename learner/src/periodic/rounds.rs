//! Cuts recordings into rounds, and brings the rounds to a common time.

use glam::{DQuat, DVec3};
use tprmp_rmpflow::policy::canonical::frame_map::{Anchor, FrameMap};
use tprmp_spatial::Pose;
use tprmp_spatial::rotation::rotation_vector;

use crate::alignment::resample::between;
use crate::alignment::rest::DemonstrationError;
use crate::canonical::ANGLE_MAX_RAD;
use crate::canonical::means::mean_orientation;
use crate::canonical::path::Path;
use crate::canonical::scales::{scales, span};
use crate::demonstration::Demonstration;
use crate::periodic::laps::laps;
use crate::periodic::recurrence::PLACES;
use crate::periodic::smoothing::smooth_round;
use crate::periodic::trace::seen;
use crate::periodic::tracking::Lap;
use crate::skill::Skill;

/// Fewest and most samples of a round, …
const SAMPLES: [f64; 2] = [120.0, 300.0];
/// … and about the most of all, so that a fit of many takes seconds.
const SAMPLES_IN_ALL: f64 = 6000.0;

/// Of all complete rounds so many are fitted, evenly spread over each demonstration, and one of each at least.
const FITTED: usize = 50;

/// A round in canonical coordinates, which are those of the frame; the rotation vector is that from the mean
/// orientation. It is closed: its end is its beginning.
pub(super) struct Round {
    /// Which demonstration it is from.
    pub demonstration: usize,
    /// Positions \[m\].
    pub position: Path,
    /// Rotation vectors \[rad\].
    pub rotation: Path,
    /// How long it lasted \[s\].
    pub duration_s: f64,
    /// Samples of the recording between which it lies.
    pub samples: std::ops::Range<usize>,
}

/// All rounds of all demonstrations, at the same phases.
pub(super) struct Rounds {
    /// Those that are fitted; at least two.
    pub all: Vec<Round>,
    /// How many each demonstration has; at least one.
    pub counts: Vec<u32>,
    /// Phase of each sample of a round: k/count.
    pub phases: Vec<f64>,
    /// Median duration \[s\].
    pub period_s: f64,
    /// Mean pose of the tool, seen from the frame.
    pub centre: Pose,
    /// s in ŷ = s y [1/m, 1/rad].
    pub scales: [f64; 2],
    /// Mean length of a round \[ŷ\].
    pub length: f64,
    /// The mean round: positions and rotation vectors.
    pub mean: [Vec<DVec3>; 2],
}

impl Rounds {
    /// Finds the rounds of demonstrations.
    ///
    /// # Errors
    /// [`DemonstrationError`]: none comes again, one has no complete round, drifts or runs beside the others, there is
    /// one round in all, or one is rotated by almost 180° against the mean.
    pub(super) fn find(
        skill: &Skill,
        demonstrations: &[Demonstration],
    ) -> Result<Self, DemonstrationError> {
        let recordings: Vec<Vec<Pose>> = demonstrations.iter().map(seen).collect();
        let laps = laps(skill, demonstrations, &recordings)?;
        let counts: Vec<u32> = (0..recordings.len())
            .map(|i| laps.iter().filter(|lap| lap.recording == i).count() as u32)
            .collect();
        let common = CommonRound::new(skill, demonstrations, &laps);
        let laps = spread(laps, &counts);
        let per_sample = |lap: &Lap| &demonstrations[lap.recording];
        let shortest =
            laps.iter().map(|lap| per_sample(lap).sampling_time_s).fold(f64::MAX, f64::min);
        let most = (SAMPLES_IN_ALL / laps.len() as f64).clamp(SAMPLES[0], SAMPLES[1]);
        let count = (common.period_s / shortest).clamp(SAMPLES[0], most).round() as usize;
        let phases: Vec<f64> = (0..count).map(|i| i as f64 / count as f64).collect();
        let sampled: Vec<Vec<Pose>> = laps
            .iter()
            .map(|lap| common.sampled(lap, &recordings[lap.recording], &phases))
            .collect();
        let centre = centre(&sampled);
        let mut all = Vec::with_capacity(laps.len());
        for (lap, poses) in laps.iter().zip(&sampled) {
            let demonstration = &demonstrations[lap.recording];
            let charted = charted(demonstration, poses, &centre)?;
            let begin = common.phase(lap.first as f64);
            let period_s = common.period_s;
            let smoothed = |points: Vec<DVec3>| smooth_round(skill, points, begin, period_s);
            let [position, rotation] = charted.map(smoothed);
            all.push(Round {
                demonstration: lap.recording,
                position,
                rotation,
                duration_s: duration_s(lap, demonstration),
                samples: lap.samples[0] as usize..lap.samples[PLACES] as usize + 1,
            });
        }
        let scales = scales(
            &skill.scale,
            span(all.iter().map(|round| &round.position), DQuat::IDENTITY),
            span(all.iter().map(|round| &round.rotation), DQuat::IDENTITY),
        );
        let mean = |of: fn(&Round) -> &Path| -> Vec<DVec3> {
            let at = |i: usize| all.iter().map(|round| of(round).points[i]).sum::<DVec3>();
            (0..count).map(|i| at(i) / all.len() as f64).collect()
        };
        let mean = [mean(|round| &round.position), mean(|round| &round.rotation)];
        let period_s = common.period_s;
        let length = all.iter().map(|round| length(round, scales)).sum::<f64>() / all.len() as f64;
        Ok(Self { all, counts, phases, period_s, centre, scales, length, mean })
    }

    /// The map of the frame: canonical coordinates are its own.
    ///
    /// # Panics
    /// Never: a map of one frame exists.
    pub(super) fn map(&self) -> FrameMap {
        let frame = Pose::IDENTITY;
        let anchor = Anchor { index: 0, frame, point: self.centre.position, phase: 0.0 };
        FrameMap::new(&[anchor], self.centre, true).expect("there is one frame")
    }

    /// Largest acceleration of the rounds [m/s²].
    pub(super) fn acceleration_max_m_s2(&self) -> f64 {
        let all = self.all.iter().flat_map(|round| &round.position.accelerations);
        all.map(|a| a.length()).fold(0.0, f64::max)
    }

    /// The mean round as poses seen from the frame.
    pub(super) fn mean_poses(&self) -> Vec<Pose> {
        let pose = |(position, rotation): (&DVec3, &DVec3)| Pose {
            position: *position,
            orientation: self.centre.orientation * DQuat::from_scaled_axis(*rotation),
        };
        self.mean[0].iter().zip(&self.mean[1]).map(pose).collect()
    }
}

/// The rounds that are fitted, of all.
fn spread(laps: Vec<Lap>, counts: &[u32]) -> Vec<Lap> {
    let most = (FITTED / counts.len()).max(1);
    let (mut kept, mut all) = (Vec::new(), laps.into_iter());
    for count in counts.iter().map(|count| *count as usize) {
        let fitted = count.min(most);
        let begins = |i: usize| (i + 1) * fitted / count > i * fitted / count;
        let own = all.by_ref().take(count).enumerate();
        kept.extend(own.filter(|(i, _)| begins(*i)).map(|(_, lap)| lap));
    }
    kept
}

fn duration_s(lap: &Lap, demonstration: &Demonstration) -> f64 {
    (lap.samples[PLACES] - lap.samples[0]) * demonstration.sampling_time_s
}

/// The common timing of the rounds.
struct CommonRound {
    /// Phase, rising, at each place from `first` on, to 1.
    phases: Vec<f64>,
    /// The place at phase 0: where the motion is fast.
    first: usize,
    period_s: f64,
}

impl CommonRound {
    fn new(skill: &Skill, demonstrations: &[Demonstration], laps: &[Lap]) -> Self {
        let durations: Vec<f64> =
            laps.iter().map(|lap| duration_s(lap, &demonstrations[lap.recording])).collect();
        let period_s = middle(durations);
        let pace = |place: usize| {
            let of = |lap: &Lap| {
                let j = (place + PLACES - lap.first) % PLACES;
                (lap.samples[j + 1] - lap.samples[j]) / (lap.samples[PLACES] - lap.samples[0])
            };
            middle(laps.iter().map(of).collect())
        };
        let paces: Vec<f64> = (0..PLACES).map(pace).collect();
        let width = skill.alignment.width * PLACES as f64;
        let smooth = |place: usize| {
            let weight = |by: i64| (-0.5 * (by as f64 / width).powi(2)).exp();
            let half = PLACES as i64 / 2;
            let at = |by: i64| paces[(place as i64 + by).rem_euclid(PLACES as i64) as usize];
            let sum: f64 = (-half..half).map(|by| weight(by) * at(by)).sum();
            sum / (-half..half).map(weight).sum::<f64>()
        };
        // No place takes no time at all.
        let least = 0.05 / PLACES as f64;
        let paces: Vec<f64> = (0..PLACES).map(|place| smooth(place).max(least)).collect();
        let first = (0..PLACES).min_by(|i, j| paces[*i].total_cmp(&paces[*j])).unwrap_or(0);
        let whole: f64 = paces.iter().sum();
        let mut phases = vec![0.0];
        for i in 0..PLACES {
            phases.push(phases[i] + paces[(first + i) % PLACES] / whole);
        }
        phases[PLACES] = 1.0;
        Self { phases, first, period_s }
    }

    /// The phase of a place.
    fn phase(&self, place: f64) -> f64 {
        let from_first = (place - self.first as f64).rem_euclid(PLACES as f64);
        let i = (from_first as usize).min(PLACES - 1);
        self.phases[i] + (from_first - i as f64) * (self.phases[i + 1] - self.phases[i])
    }

    /// The place of a phase in [0, 1).
    fn place(&self, phase: f64) -> f64 {
        let i = self.phases.partition_point(|s| *s <= phase).clamp(1, PLACES) - 1;
        let fraction = (phase - self.phases[i]) / (self.phases[i + 1] - self.phases[i]);
        self.first as f64 + i as f64 + fraction
    }

    /// The poses of a round at these phases, and last that at its end.
    fn sampled(&self, lap: &Lap, recorded: &[Pose], phases: &[f64]) -> Vec<Pose> {
        let sample = |from_first: f64| {
            let j = (from_first as usize).min(PLACES - 1);
            let (a, b) = (lap.samples[j], lap.samples[j + 1]);
            between(recorded, a + (from_first - j as f64) * (b - a))
        };
        let at =
            |phase: &f64| sample((self.place(*phase) - lap.first as f64).rem_euclid(PLACES as f64));
        let ends = [0.0, PLACES as f64].map(sample);
        phases.iter().map(at).chain(ends).collect()
    }
}

fn middle(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    0.5 * (values[last / 2] + values[last.div_ceil(2)])
}

/// The mean pose of rounds, each of which has its ends besides.
fn centre(sampled: &[Vec<Pose>]) -> Pose {
    let all: Vec<Pose> =
        sampled.iter().flat_map(|poses| &poses[..poses.len() - 2]).copied().collect();
    let position = all.iter().map(|pose| pose.position).sum::<DVec3>() / all.len() as f64;
    let orientations: Vec<DQuat> = all.iter().map(|pose| pose.orientation).collect();
    let orientation = mean_orientation(&orientations, &vec![1.0; orientations.len()]);
    Pose { position, orientation }
}

/// Positions and rotation vectors of a round.
fn charted(
    demonstration: &Demonstration,
    poses: &[Pose],
    centre: &Pose,
) -> Result<[Vec<DVec3>; 2], DemonstrationError> {
    let rotation = |pose: &Pose| rotation_vector(centre.orientation.conjugate() * pose.orientation);
    let rotations: Vec<DVec3> = poses.iter().map(rotation).collect();
    let most = rotations.iter().map(|r| r.length()).fold(0.0, f64::max);
    if most > ANGLE_MAX_RAD {
        let problem = format!(
            "in a round it is rotated by {:.0}° against the mean orientation; at most {:.0}° can be learned: a tool \
             that turns on and on has no mean",
            most.to_degrees(),
            ANGLE_MAX_RAD.to_degrees()
        );
        return Err(DemonstrationError { name: demonstration.name.clone(), problem });
    }
    Ok([poses.iter().map(|pose| pose.position).collect(), rotations])
}

/// Length of a round \[ŷ\].
fn length(round: &Round, scales: [f64; 2]) -> f64 {
    let count = round.position.points.len();
    let way = |path: &Path, scale: f64, i: usize| {
        (path.points[(i + 1) % count] - path.points[i]).length() * scale
    };
    let step =
        |i: usize| way(&round.position, scales[0], i).hypot(way(&round.rotation, scales[1], i));
    (0..count).map(step).sum()
}
