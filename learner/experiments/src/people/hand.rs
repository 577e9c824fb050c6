//! A hand that demonstrates: it keeps no time, rests before and after, and trembles.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tprmp_learner::demonstration::Demonstration;
use tprmp_model::skill_model::{Manifold, Remarks};
use tprmp_spatial::Pose;

use crate::people::scene::{Frames, GATE, Scene};

/// Waves that a pace is made of.
const WAVES: usize = 3;
/// Steps of the table of a pace.
const STEPS: usize = 400;
/// Frequency of a hand's tremor \[Hz\], from and to.
const TREMOR_HZ: [f64; 2] = [8.0, 12.0];
/// Part of the tremor's variance that is a wave; the rest is a sensor's noise.
const WAVE_PART: f64 = 0.5;
/// Length of a dropout \[samples\], from and to.
const DROPOUT: std::ops::RangeInclusive<usize> = 2..=4;

/// How a hand demonstrates. Lengths and angles of noise are standard deviations in each coordinate.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Hand {
    /// Samples a second
    #[arg(long, default_value_t = Self::default().rate_hz)]
    pub rate_hz: f64,
    /// Mean duration of a demonstration, in seconds
    #[arg(long, default_value_t = Self::default().duration_s)]
    pub duration_s: f64,
    /// Durations differ by up to this fraction
    #[arg(long, default_value_t = Self::default().duration_spread)]
    pub duration_spread: f64,
    /// How much the pace changes within a demonstration: standard deviation of its logarithm
    #[arg(long, default_value_t = Self::default().warp)]
    pub warp: f64,
    /// Shortest rest before and after, in seconds …
    #[arg(long, default_value_t = Self::default().pause_min_s)]
    pub pause_min_s: f64,
    /// … and longest, in seconds
    #[arg(long, default_value_t = Self::default().pause_max_s)]
    pub pause_max_s: f64,
    /// Tremor of positions, in millimetres
    #[arg(long, default_value_t = Self::default().tremor_mm)]
    pub tremor_mm: f64,
    /// Tremor of orientations, in degrees
    #[arg(long, default_value_t = Self::default().tremor_deg)]
    pub tremor_deg: f64,
    /// Fraction of the samples that are lost, a few in a row, and filled linearly
    #[arg(long, default_value_t = Self::default().dropouts)]
    pub dropouts: f64,
}

impl Default for Hand {
    fn default() -> Self {
        Self {
            rate_hz: 30.0,
            duration_s: 4.5,
            duration_spread: 0.2,
            warp: 0.35,
            pause_min_s: 0.7,
            pause_max_s: 1.4,
            tremor_mm: 1.2,
            tremor_deg: 0.3,
            dropouts: 0.0,
        }
    }
}

/// What of a recording differs between the rows of a comparison: frames, paths and noise are the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timing {
    /// As a person gives it.
    AsRecorded,
    /// Without the rests, cut where they truly end.
    WithoutPauses,
    /// As one who keeps time would: neither rests nor a pace of its own.
    KeepingTime,
    /// Without the rests, retimed to keep time, then pace and duration put back.
    PaceAndDuration,
}

impl Timing {
    /// All, in the order of the table.
    pub const ALL: [Self; 4] =
        [Self::AsRecorded, Self::WithoutPauses, Self::KeepingTime, Self::PaceAndDuration];
}

impl std::fmt::Display for Timing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::AsRecorded => "as recorded",
            Self::WithoutPauses => "true pauses cut",
            Self::KeepingTime => "all keeping time",
            Self::PaceAndDuration => "keeping time, pace and duration put back",
        })
    }
}

impl Hand {
    /// Whether a hand can demonstrate so.
    ///
    /// # Errors
    /// The option, what was expected and found.
    pub fn check(&self, count: usize) -> Result<(), String> {
        let ranges = [
            ("--count", count as f64, 1.0, 1000.0),
            ("--rate-hz", self.rate_hz, 5.0, 1000.0),
            ("--duration-s", self.duration_s, 0.5, 100.0),
            ("--duration-spread", self.duration_spread, 0.0, 0.9),
            ("--warp", self.warp, 0.0, 2.0),
            ("--pause-min-s", self.pause_min_s, 0.0, 60.0),
            ("--pause-max-s", self.pause_max_s, self.pause_min_s, 60.0),
            ("--tremor-mm", self.tremor_mm, 0.0, 100.0),
            ("--tremor-deg", self.tremor_deg, 0.0, 45.0),
            ("--dropouts", self.dropouts, 0.0, 0.9),
        ];
        match ranges.iter().find(|(_, found, least, most)| !(*least..=*most).contains(found)) {
            None => Ok(()),
            Some((option, found, least, most)) => {
                Err(format!("option `{option}`: expected {least} to {most}, found {found}"))
            }
        }
    }

    /// `count` demonstrations of a scene; the seed says which.
    #[must_use]
    pub fn demonstrate(
        &self,
        scene: Scene,
        timing: Timing,
        count: usize,
        seed: u64,
    ) -> Vec<Demonstration> {
        let one = |i: usize| {
            // A stream for each: what is drawn for one moves no other.
            let stream = |which: u64| {
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                random.set_stream(4 * i as u64 + which);
                random
            };
            let frames = scene.frames(&mut stream(0));
            let pace = self.pace(timing, &mut stream(1));
            let path = scene.path(&frames);
            let fractions = pace.fractions(1.0 / self.rate_hz);
            let mut poses: Vec<Pose> = fractions.iter().map(|s| path.at(*s)).collect();
            self.tremble(&mut poses, &mut stream(2));
            self.drop_out(&mut poses, &mut stream(3));
            demonstration(i, scene, &frames, 1.0 / self.rate_hz, poses)
        };
        (0..count).map(one).collect()
    }

    fn pace(&self, timing: Timing, random: &mut ChaCha8Rng) -> Pace {
        let duration = 1.0 + self.duration_spread * random.random_range(-1.0..=1.0);
        let amplitude = self.warp * (2.0 / WAVES as f64).sqrt();
        let waves = std::array::from_fn(|_| {
            (amplitude * random.random_range(0.5..1.5), TAU * random.random::<f64>())
        });
        let rests = [0, 1].map(|_| random.random_range(self.pause_min_s..=self.pause_max_s));
        let keeps_time = timing == Timing::KeepingTime;
        Pace {
            duration_s: self.duration_s * if keeps_time { 1.0 } else { duration },
            waves: if keeps_time { [(0.0, 0.0); WAVES] } else { waves },
            rests_s: if timing == Timing::AsRecorded { rests } else { [0.0; 2] },
        }
    }

    fn tremble(&self, poses: &mut [Pose], random: &mut ChaCha8Rng) {
        let wave: [(f64, f64); 6] = std::array::from_fn(|_| {
            let [slow, fast] = TREMOR_HZ;
            (random.random_range(slow..fast), TAU * random.random::<f64>())
        });
        for (k, pose) in poses.iter_mut().enumerate() {
            let time_s = k as f64 / self.rate_hz;
            let noise: [f64; 6] = std::array::from_fn(|c| {
                let (frequency, phase) = wave[c];
                let swing = (2.0 * WAVE_PART).sqrt() * (TAU * frequency * time_s + phase).sin();
                swing + (1.0 - WAVE_PART).sqrt() * normal(random)
            });
            let [x, y, z, a, b, c] = noise;
            pose.position += DVec3::new(x, y, z) * (1e-3 * self.tremor_mm);
            let by = DVec3::new(a, b, c) * self.tremor_deg.to_radians();
            pose.orientation = (DQuat::from_scaled_axis(by) * pose.orientation).normalize();
        }
    }

    fn drop_out(&self, poses: &mut [Pose], random: &mut ChaCha8Rng) {
        let mean = 0.5 * (DROPOUT.start() + DROPOUT.end()) as f64;
        let mut k = 1;
        while k + DROPOUT.end() < poses.len() {
            if random.random::<f64>() < self.dropouts / mean {
                let length = random.random_range(DROPOUT);
                let (before, after) = (poses[k - 1], poses[k + length]);
                for lost in 0..length {
                    let part = (lost + 1) as f64 / (length + 1) as f64;
                    poses[k + lost] = before.interpolate(&after, part);
                }
                k += length;
            }
            k += 1;
        }
    }
}

/// How fast a demonstration goes.
struct Pace {
    duration_s: f64,
    /// Amplitude and phase of the waves of the logarithm of the pace.
    waves: [(f64, f64); WAVES],
    rests_s: [f64; 2],
}

impl Pace {
    /// Fraction of the path's length at each sample.
    fn fractions(&self, step_s: f64) -> Vec<f64> {
        let pace = |x: f64| -> f64 {
            let waves = self.waves.iter().enumerate();
            let sum: f64 =
                waves.map(|(k, (a, phase))| a * ((k + 1) as f64 * PI * x + phase).cos()).sum();
            sum.exp()
        };
        let mut table = vec![0.0];
        for i in 0..STEPS {
            table.push(table[i] + pace((i as f64 + 0.5) / STEPS as f64));
        }
        let [before, after] = self.rests_s;
        let count = ((before + self.duration_s + after) / step_s).round() as usize + 1;
        let at = |k: usize| {
            let t = ((k as f64 * step_s - before) / self.duration_s).clamp(0.0, 1.0);
            let place = t * STEPS as f64;
            let i = (place as usize).min(STEPS - 1);
            let warped = table[i] + (place - i as f64) * (table[i + 1] - table[i]);
            let t = warped / table[STEPS];
            // From rest to rest with the least jerk, slower towards the end, as people place things.
            let s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
            s * (1.25 - 0.25 * s)
        };
        (0..count).map(at).collect()
    }
}

/// A normal number, by Box and Muller.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
    (-2.0 * a.ln()).sqrt() * (TAU * b).cos()
}

fn demonstration(
    i: usize,
    scene: Scene,
    frames: &Frames,
    sampling_time_s: f64,
    poses: Vec<Pose>,
) -> Demonstration {
    let other_frames: BTreeMap<String, Pose> =
        frames.gate.map(|gate| (GATE.to_owned(), gate)).into_iter().collect();
    Demonstration {
        name: format!("{:02}.json", i + 1),
        sha256: String::new(),
        skill: match scene {
            Scene::Insertion => "insertion",
            Scene::Gate => "gate",
            Scene::Place => "place",
        }
        .into(),
        manifold: Manifold::R3S3,
        sampling_time_s,
        start: frames.start,
        goal_frame: frames.goal,
        other_frames,
        remarks: Remarks::default(),
        poses,
        gripper: None,
    }
}
