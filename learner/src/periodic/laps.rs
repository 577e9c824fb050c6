//! The complete rounds of all recordings, and what is wrong with a recording that has none.

use glam::{DQuat, DVec3};
use tprmp_spatial::Pose;

use crate::alignment::rest::DemonstrationError;
use crate::canonical::means::mean_orientation;
use crate::demonstration::Demonstration;
use crate::periodic::recurrence::Recurrence;
use crate::periodic::trace::{Feature, Trace, Units};
use crate::periodic::tracking::{Lap, Track};
use crate::skill::Skill;

/// Fewest rounds in all.
const ROUNDS_MIN: usize = 2;
/// How often the mean round and where recordings are on it are found anew.
const REFINED: usize = 2;
/// So many recordings that come again are tried as what all follow.
const TRIED: usize = 8;
/// Rounds that move by more than this fraction of their span, in all, are no rounds in place.
const DRIFT_MAX: f64 = 0.12;

/// Recordings, along their lengths.
struct Recordings<'a> {
    skill: &'a Skill,
    demonstrations: &'a [Demonstration],
    units: Units,
    traces: Vec<Trace>,
}

/// The complete rounds of all recordings.
///
/// # Errors
/// [`DemonstrationError`]: none comes again, one drifts, has no complete round or runs beside the others, or there is
/// one round in all.
pub(super) fn laps(
    skill: &Skill,
    demonstrations: &[Demonstration],
    recordings: &[Vec<Pose>],
) -> Result<Vec<Lap>, DemonstrationError> {
    let all: Vec<DQuat> =
        recordings.iter().flatten().map(|pose| pose.orientation).step_by(7).collect();
    let units = Units::new(skill, recordings, mean_orientation(&all, &vec![1.0; all.len()]));
    let traces = recordings
        .iter()
        .zip(demonstrations)
        .map(|(poses, d)| Trace::new(skill, poses, d.sampling_time_s, units))
        .collect();
    Recordings { skill, demonstrations, units, traces }.laps()
}

impl Recordings<'_> {
    fn failed(&self, i: usize, problem: String) -> DemonstrationError {
        DemonstrationError { name: self.demonstrations[i].name.clone(), problem }
    }

    fn laps(&self) -> Result<Vec<Lap>, DemonstrationError> {
        let Recurrence { length, mut round, .. } = self.common()?;
        let mut tracks = self.follow(&round, length, None);
        for _ in 0..REFINED {
            round = mean_round(&tracks, &round);
            let mut apart: Vec<f64> =
                tracks.iter().filter_map(|track| track.distance(&round)).collect();
            apart.sort_by(f64::total_cmp);
            tracks = self.follow(&round, length, apart.get(apart.len() / 2).copied());
        }
        let mut laps = Vec::new();
        for (i, track) in tracks.iter().enumerate() {
            let own = track.laps(i);
            if own.is_empty() {
                return Err(self.failed(i, self.without_round(i, &round, length)));
            }
            laps.extend(own);
        }
        if laps.len() < ROUNDS_MIN {
            let problem = format!(
                "{} complete round was found in all, expected at least {ROUNDS_MIN}: go round several times at a \
                 stretch, or record further files, of one closed round each",
                laps.len()
            );
            return Err(self.failed(0, problem));
        }
        Ok(laps)
    }

    fn follow(&self, round: &[Feature], length: f64, usual: Option<f64>) -> Vec<Track> {
        self.traces.iter().map(|trace| Track::new(trace, round, length, usual)).collect()
    }

    /// The round that most recordings follow.
    fn common(&self) -> Result<Recurrence, DemonstrationError> {
        let mut found: Vec<(usize, Recurrence)> = self.each(Recurrence::of);
        self.refuse_drift(&found)?;
        if found.is_empty() {
            found = self.each(Recurrence::closed_once);
        }
        found.sort_by(|(_, a), (_, b)| a.nearest_first(b));
        found.truncate(TRIED);
        // Of those that come again, what most recordings do is the skill; of several, what comes again the nearest.
        let complete = |(_, found): &(usize, Recurrence)| {
            let tracks = self.follow(&found.round, found.length, None);
            tracks.iter().filter(|track| !track.laps(0).is_empty()).count()
        };
        let counts: Vec<usize> = match found.len() {
            1 => vec![1],
            _ => found.iter().map(complete).collect(),
        };
        let most = counts.iter().copied().max().unwrap_or(0);
        let best = found.into_iter().zip(counts).find(|(_, count)| *count == most);
        best.map(|((_, found), _)| found).ok_or_else(|| {
            let others =
                if self.traces.len() > 1 { ", nor does any other demonstration" } else { "" };
            let problem = format!(
                "its motion does not come again{others}: expected a periodic skill to be demonstrated in two rounds \
                 or more at a stretch, or in several files of one closed round each"
            );
            self.failed(0, problem)
        })
    }

    fn each(&self, of: fn(&Trace) -> Option<Recurrence>) -> Vec<(usize, Recurrence)> {
        let all = self.traces.iter().enumerate();
        all.filter_map(|(i, trace)| of(trace).map(|found| (i, found))).collect()
    }

    /// Refuses recordings whose rounds move on and on: the one that moves farthest.
    fn refuse_drift(&self, found: &[(usize, Recurrence)]) -> Result<(), DemonstrationError> {
        let fraction = |(i, found): &(usize, Recurrence)| {
            let rounds = (self.traces[*i].length() / found.length).round() - 1.0;
            (found.drift.length() * rounds / span(&found.round), *i, rounds, found.drift)
        };
        let farthest = found.iter().map(fraction).max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((fraction, i, rounds, drift)) = farthest else { return Ok(()) };
        if fraction <= DRIFT_MAX {
            return Ok(());
        }
        let each_mm = 1e3 * self.metres(drift);
        let problem = format!(
            "its rounds move by {each_mm:.1} mm a round in `{}`, by about {:.0} mm in all; expected rounds in place, \
             within {:.0} % of their span: record it anew, or fix the frame to what moves",
            self.skill.goal_frame,
            each_mm * rounds,
            100.0 * DRIFT_MAX
        );
        Err(self.failed(i, problem))
    }

    fn metres(&self, change: DVec3) -> f64 {
        change.length() / self.units.0[0]
    }

    /// Why a recording has no complete round.
    fn without_round(&self, i: usize, round: &[Feature], length: f64) -> String {
        let trace = &self.traces[i];
        let middle =
            |features: &[Feature]| features.iter().sum::<Feature>() / features.len() as f64;
        let own = Recurrence::of(trace).or_else(|| Recurrence::closed_once(trace));
        let own = own.map_or_else(|| trace.middle(), |own| middle(&own.round));
        // Where the tool is, not how it is rotated.
        let place =
            |feature: Feature| Feature::from_fn(|i, _| if i < 3 { feature[i] } else { 0.0 });
        let mut beside = place(own - middle(round));
        for _ in 0..REFINED {
            let track = Track::new(&trace.moved(&-beside), round, length, None);
            let (sum, count) =
                track.steps().fold((Feature::zeros(), 0.0), |(sum, count), (at, feature)| {
                    (sum + feature - round[at], count + 1.0)
                });
            if count > 0.0 {
                beside += place(sum / count);
            }
        }
        if Track::new(&trace.moved(&-beside), round, length, None).laps(i).is_empty() {
            return "has no complete round of the motion that the demonstrations have in common: is it another one, \
                    does it go the other way round, or was it ended early?"
                .into();
        }
        let beside = DVec3::new(beside[0], beside[1], beside[2]);
        format!(
            "runs {:.1} mm beside the others in `{frame}`; expected rounds at the same place: record it anew, or \
             correct the pose of `{frame}` in the file",
            1e3 * self.metres(beside),
            frame = self.skill.goal_frame
        )
    }
}

/// How far a round spans in position, in units of the features.
fn span(round: &[Feature]) -> f64 {
    let at = |feature: &Feature| DVec3::new(feature[0], feature[1], feature[2]);
    let least = round.iter().map(at).fold(DVec3::INFINITY, DVec3::min);
    let most = round.iter().map(at).fold(DVec3::NEG_INFINITY, DVec3::max);
    (most - least).length()
}

/// The mean of what recordings are at each place; where there is none, as before.
fn mean_round(tracks: &[Track], before: &[Feature]) -> Vec<Feature> {
    let mut sums = vec![(Feature::zeros(), 0.0); before.len()];
    for (place, feature) in tracks.iter().flat_map(Track::steps) {
        sums[place].0 += feature;
        sums[place].1 += 1.0;
    }
    let each = sums.iter().zip(before);
    each.map(|((sum, count), before)| if *count > 0.0 { sum / *count } else { *before }).collect()
}
