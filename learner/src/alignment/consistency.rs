//! Demonstrations that do not fit each other: quaternions in another order, a frame that is rotated, stale or
//! another one, a motion that was cut short, two ends. They are warned of, with file, place and size.
//!
//! All of it is seen in how the tool starts in the start frame and ends in the goal frame: there people
//! demonstrate the same.

use glam::{DQuat, DVec3};
use tprmp_spatial::Pose;
use tprmp_spatial::rotation::rotation_vector;

use crate::alignment::groups::{Groups, groups};
use crate::demonstration::{Demonstration, largest_span_m};
use crate::skill::Skill;

/// Orientations of people who do the same differ by less \[rad\] …
const ANGLE_MIN_RAD: f64 = 15.0 * std::f64::consts::PI / 180.0;
/// … and positions by less than this fraction of the span.
const DISTANCE_FRACTION: f64 = 0.02;
/// One that is so many times as far from the others as they are from each other is none of them.
const OUTLIER_RATIO: f64 = 5.0;
/// Quaternions in the right order start nearer to the start frame than this \[rad\] …
const SAME_ORDER_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// … and those in another one are farther away.
const OTHER_ORDER_RAD: f64 = 30.0 * std::f64::consts::PI / 180.0;
/// All in another order lie so many times nearer to each other in the right one.
const REORDERED_RATIO: f64 = 5.0;
/// Demonstrations scatter when their ends lie farther apart than this fraction of the span, rms …
const SCATTER_FRACTION: f64 = 0.02;
/// … or than this angle \[rad\].
const SCATTER_RAD: f64 = 8.0 * std::f64::consts::PI / 180.0;
/// A motion that ends faster than this fraction of its largest speed was cut.
const END_SPEED_FRACTION: f64 = 0.2;
/// Over how many samples its last speed is taken.
const END_SAMPLES: usize = 4;
/// Of groups that are learned together.
const NEITHER: &str = "; their mean is neither: are these two ways of doing it?";
/// Axes that are named instead of written as numbers are this near to one, as a cosine.
const ALONG_AXIS: f64 = 0.996;

/// What does not fit: a sentence each, which names files and frames.
#[must_use]
pub fn warnings(skill: &Skill, demonstrations: &[Demonstration]) -> Vec<String> {
    let has_orientation = skill.manifold.has_orientation();
    if has_orientation && let Some(all) = all_in_another_order(skill, demonstrations) {
        return vec![all];
    }
    let ends = Ends::new(skill, demonstrations);
    let mut warnings = Vec::new();
    let mut odd = vec![false; demonstrations.len()];
    if has_orientation {
        for (i, order) in in_another_order(skill, demonstrations, &ends) {
            odd[i] = true;
            warnings.push(format!("`{}` {order}", demonstrations[i].name));
        }
        warnings.extend(ends.rotations(&mut odd));
    }
    warnings.extend(ends.positions(&mut odd));
    if warnings.is_empty() {
        warnings.extend(ends.scatter());
    }
    warnings
}

/// Groups of two demonstrations or more that end apart in the goal frame: the group of each, and a sentence about
/// them. Not where another order of quaternions explains it.
pub(crate) fn ends_apart(
    skill: &Skill,
    demonstrations: &[Demonstration],
) -> Option<(Vec<usize>, String)> {
    let ends = Ends::new(skill, demonstrations);
    if skill.manifold.has_orientation() {
        let reordered = all_in_another_order(skill, demonstrations).is_some()
            || !in_another_order(skill, demonstrations, &ends).is_empty();
        if reordered {
            return None;
        }
        if let Some(found) = ends.orientations_apart() {
            return Some(found);
        }
    }
    ends.positions_apart()
}

/// Whether one demonstration ends where the others do, and starts so in their frames.
pub(crate) fn ends_like_the_others(
    skill: &Skill,
    demonstrations: &[Demonstration],
    index: usize,
) -> bool {
    let ends = Ends::new(skill, demonstrations);
    let apart = |end: usize| {
        let other = if demonstrations.len() == 2 { 1 - index } else { ends.middle[end] };
        let (here, others) = (&ends.poses[end][index], &ends.poses[end][other]);
        let rotates = skill.manifold.has_orientation();
        let angle = if rotates { here.rotation_from(others).length() } else { 0.0 };
        (here.position - others.position).length() > DISTANCE_FRACTION * ends.span_m
            || angle > ANGLE_MIN_RAD
    };
    !(apart(1) || (skill.has_start_frame() && apart(0)))
}

/// Where quaternions may have been read in another order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reordered {
    Samples,
    Frames,
    Both,
}

impl Reordered {
    const ALL: [Self; 3] = [Self::Samples, Self::Frames, Self::Both];

    /// The demonstration as it would be.
    fn applied(self, demonstration: &Demonstration) -> Demonstration {
        // The first of four was read as w, and is x.
        let reordered = |pose: &mut Pose| {
            let DQuat { x, y, z, w } = pose.orientation;
            pose.orientation = DQuat::from_xyzw(w, x, y, z);
        };
        let mut other = demonstration.clone();
        if self != Self::Frames {
            other.poses.iter_mut().for_each(reordered);
        }
        if self != Self::Samples {
            [&mut other.start, &mut other.goal_frame].into_iter().for_each(reordered);
        }
        other
    }
}

impl std::fmt::Display for Reordered {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Samples => "the quaternions of the samples",
            Self::Frames => "the quaternions of the frames",
            Self::Both => "the quaternions of samples and frames",
        })
    }
}

/// Angle of the tool at the start against the start frame \[rad\].
fn start_angle(demonstration: &Demonstration) -> f64 {
    demonstration.poses[0].rotation_from(&demonstration.start).length()
}

/// All files alike: then nothing differs from the others, but the tool starts rotated against the start
/// frame, or every end lies elsewhere in the goal frame.
fn all_in_another_order(skill: &Skill, demonstrations: &[Demonstration]) -> Option<String> {
    let reordered = |order: &Reordered| -> Vec<Demonstration> {
        demonstrations.iter().map(|d| order.applied(d)).collect()
    };
    if skill.has_start_frame() && demonstrations.iter().all(|d| start_angle(d) > OTHER_ORDER_RAD) {
        let fits =
            |order: &Reordered| reordered(order).iter().all(|d| start_angle(d) < SAME_ORDER_RAD);
        let order = Reordered::ALL.into_iter().find(fits)?;
        let angle = |d: &&Demonstration| start_angle(d).to_degrees();
        let worst = demonstrations.iter().max_by(|a, b| angle(a).total_cmp(&angle(b)))?;
        return Some(format!(
            "in all files the tool starts rotated against `{}`, by {:.0}° in `{}`, and would not if {order} \
             were x y z w: expected w x y z",
            skill.start_frame,
            angle(&worst),
            worst.name
        ));
    }
    let apart = Ends::new(skill, demonstrations).largest_deviation();
    if apart < OTHER_ORDER_RAD {
        return None;
    }
    let fits = |order: &Reordered| {
        Ends::new(skill, &reordered(order)).largest_deviation() < apart / REORDERED_RATIO
    };
    let order = Reordered::ALL.into_iter().find(fits)?;
    Some(format!(
        "the tool ends rotated by up to {:.0}° against other demonstrations in `{}`, and all would end alike \
         if {order} were x y z w: expected w x y z",
        apart.to_degrees(),
        skill.goal_frame
    ))
}

/// Those that fit the others only with their quaternions in another order.
fn in_another_order(
    skill: &Skill,
    demonstrations: &[Demonstration],
    ends: &Ends,
) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for (i, demonstration) in demonstrations.iter().enumerate() {
        let off = ends.deviation(i, demonstration);
        if off < OTHER_ORDER_RAD {
            continue;
        }
        let fits = |order: &Reordered| {
            ends.deviation(i, &order.applied(demonstration)) < 2.0 * SAME_ORDER_RAD
        };
        if let Some(order) = Reordered::ALL.into_iter().find(fits) {
            let text = format!(
                "starts and ends rotated by up to {:.0}° against the other demonstrations in `{}` and \
                 `{}`, and would not if {order} were x y z w: expected w x y z",
                off.to_degrees(),
                skill.start_frame,
                skill.goal_frame
            );
            found.push((i, text));
        }
    }
    found
}

/// Where the demonstrations start and end.
struct Ends<'a> {
    skill: &'a Skill,
    demonstrations: &'a [Demonstration],
    /// The first pose in the start frame, and the last in the goal frame.
    poses: [Vec<Pose>; 2],
    /// Of each, the demonstration that is nearest to all others.
    middle: [usize; 2],
    /// Diagonal of what the demonstrations span \[m\].
    span_m: f64,
}

fn start_in_frame(d: &Demonstration) -> Pose {
    d.start.inverse().compose(&d.poses[0])
}

fn end_in_frame(d: &Demonstration) -> Pose {
    d.goal_frame.inverse().compose(&d.poses[d.poses.len() - 1])
}

impl<'a> Ends<'a> {
    fn new(skill: &'a Skill, demonstrations: &'a [Demonstration]) -> Self {
        let poses = [
            demonstrations.iter().map(start_in_frame).collect::<Vec<_>>(),
            demonstrations.iter().map(end_in_frame).collect(),
        ];
        let span_m = largest_span_m(demonstrations);
        let middle = [0, 1].map(|end: usize| {
            let apart = |i: &usize| -> f64 {
                let here = &poses[end][*i];
                let each = poses[end].iter().map(|p| {
                    p.rotation_from(here).length()
                        + (p.position - here.position).length() / span_m.max(1e-9)
                });
                each.sum()
            };
            (0..demonstrations.len())
                .min_by(|a, b| apart(a).total_cmp(&apart(b)))
                .expect("there are demonstrations")
        });
        Self { skill, demonstrations, poses, middle, span_m }
    }

    /// The largest angle by which a demonstration starts or ends rotated against the middle one of the others.
    fn deviation(&self, i: usize, demonstration: &Demonstration) -> f64 {
        let here = [start_in_frame(demonstration), end_in_frame(demonstration)];
        let angle = |end: usize| {
            if self.middle[end] == i {
                return 0.0;
            }
            here[end].rotation_from(&self.poses[end][self.middle[end]]).length()
        };
        angle(0).max(angle(1))
    }

    /// The largest of all.
    fn largest_deviation(&self) -> f64 {
        let each = self.demonstrations.iter().enumerate().map(|(i, d)| self.deviation(i, d));
        each.fold(0.0, f64::max)
    }

    /// Rotation of each against the middle one, in the frame at the start (0) or the end (1) [rad].
    fn turned(&self, end: usize) -> Vec<DVec3> {
        let middle = self.poses[end][self.middle[end]].orientation;
        let turned = |pose: &Pose| rotation_vector(pose.orientation * middle.conjugate());
        self.poses[end].iter().map(turned).collect()
    }

    fn frame(&self, end: usize) -> &str {
        if end == 0 { &self.skill.start_frame } else { &self.skill.goal_frame }
    }

    fn rotations(&self, odd: &mut [bool]) -> Vec<String> {
        let mut warnings = Vec::new();
        let turned = [self.turned(0), self.turned(1)];
        if let Some((_, told)) = self.orientations_apart() {
            odd.fill(true);
            return vec![format!("{told}{NEITHER}")];
        }
        let outliers = [0, 1].map(|end| outliers(&turned[end], ANGLE_MIN_RAD));
        for i in 0..self.demonstrations.len() {
            if odd[i] {
                continue;
            }
            // A skill of one frame starts where it likes.
            let at = [self.skill.has_start_frame() && outliers[0][i], outliers[1][i]];
            let name = &self.demonstrations[i].name;
            let by = |end: usize| {
                let by = turned[end][i];
                format!("by {:.0}° about {}", by.length().to_degrees(), axis(by))
            };
            let text = match at {
                [false, false] => continue,
                [true, true] => format!(
                    "`{name}` starts and ends rotated against the other demonstrations ({} in `{}`, {} in \
                     `{}`): is its tool frame another one?",
                    by(0),
                    self.frame(0),
                    by(1),
                    self.frame(1)
                ),
                [true, false] => format!(
                    "`{name}` starts rotated {} in `{}` against the other demonstrations: is that frame \
                     rotated?",
                    by(0),
                    self.frame(0)
                ),
                [false, true] => format!(
                    "`{name}` ends rotated {} in `{}` against the other demonstrations: is that frame \
                     rotated, or is it another way of doing it?",
                    by(1),
                    self.frame(1)
                ),
            };
            odd[i] = true;
            warnings.push(text);
        }
        warnings
    }

    fn positions(&self, odd: &mut [bool]) -> Vec<String> {
        let ends: Vec<DVec3> = self.poses[1].iter().map(|pose| pose.position).collect();
        let least = DISTANCE_FRACTION * self.span_m;
        if let Some((_, told)) = self.positions_apart() {
            odd.fill(true);
            return vec![format!("{told}{NEITHER}")];
        }
        let middle = ends[self.middle[1]];
        let apart: Vec<DVec3> = ends.iter().map(|end| end - middle).collect();
        let outliers = outliers(&apart, least);
        let mut warnings = Vec::new();
        for (i, demonstration) in self.demonstrations.iter().enumerate() {
            if odd[i] || !outliers[i] {
                continue;
            }
            odd[i] = true;
            let why = if ends_in_motion(demonstration) {
                "it ends in motion: was it cut short?"
            } else {
                "was it cut short, or is that frame stale?"
            };
            warnings.push(format!(
                "`{}` ends {:.0} mm beside where the other demonstrations end in `{}` (sample {}): {why}",
                demonstration.name,
                1e3 * apart[i].length(),
                self.frame(1),
                demonstration.poses.len() - 1
            ));
        }
        warnings
    }

    fn orientations_apart(&self) -> Option<(Vec<usize>, String)> {
        let text = |distance: f64| format!("{:.0}°", distance.to_degrees());
        self.apart(&self.turned(1), ANGLE_MIN_RAD, text)
    }

    fn positions_apart(&self) -> Option<(Vec<usize>, String)> {
        let ends: Vec<DVec3> = self.poses[1].iter().map(|pose| pose.position).collect();
        let text = |distance: f64| format!("{:.0} mm", 1e3 * distance);
        self.apart(&ends, DISTANCE_FRACTION * self.span_m, text)
    }

    /// Groups of two demonstrations or more that end apart.
    fn apart(
        &self,
        points: &[DVec3],
        least: f64,
        text: impl Fn(f64) -> String,
    ) -> Option<(Vec<usize>, String)> {
        let points: Vec<Vec<f64>> = points.iter().map(|p| p.to_array().to_vec()).collect();
        let groups = groups(&points)?;
        if groups.distance < least || groups.smallest() < 2 {
            return None;
        }
        let told = format!(
            "the demonstrations end in {} groups in `{}`, {} apart: {}",
            number(groups.count()),
            self.frame(1),
            text(groups.distance),
            names(self.demonstrations, &groups)
        );
        Some((groups.labels, told))
    }

    /// How far all ends lie apart.
    fn scatter(&self) -> Option<String> {
        let count = self.poses[1].len() as f64;
        if self.poses[1].len() < 2 {
            return None;
        }
        let mean = self.poses[1].iter().map(|pose| pose.position).sum::<DVec3>() / count;
        let squares = self.poses[1].iter().map(|pose| (pose.position - mean).length_squared());
        let rms_m = (squares.sum::<f64>() / count).sqrt();
        let turned = self.turned(1);
        let centre = turned.iter().sum::<DVec3>() / count;
        let squares = turned.iter().map(|t| (t - centre).length_squared());
        let rms_rad = (squares.sum::<f64>() / count).sqrt();
        let rotates = self.skill.manifold.has_orientation() && rms_rad > SCATTER_RAD;
        (rms_m > SCATTER_FRACTION * self.span_m || rotates).then(|| {
            format!(
                "the demonstrations' ends scatter in `{}`, by {:.0} mm and {:.0}° (rms): the goal is their \
                 mean; is it the frame that the goal is fixed to?",
                self.frame(1),
                1e3 * rms_m,
                rms_rad.to_degrees()
            )
        })
    }
}

/// Names of the demonstrations, group by group.
pub(crate) fn names(demonstrations: &[Demonstration], groups: &Groups) -> String {
    let of = |label: usize| {
        let members =
            groups.members(label).into_iter().map(|i| format!("`{}`", demonstrations[i].name));
        members.collect::<Vec<_>>().join(", ")
    };
    (0..groups.count()).map(of).collect::<Vec<_>>().join(" and ")
}

/// A small number in words.
pub(crate) fn number(count: usize) -> String {
    match count {
        2 => "two".into(),
        3 => "three".into(),
        4 => "four".into(),
        _ => count.to_string(),
    }
}

/// Which of several points lies far from the others: farther than the least, and than a multiple of the
/// others' distance from the point at zero.
fn outliers(points: &[DVec3], least: f64) -> Vec<bool> {
    let far = |i: usize| {
        let mut others: Vec<f64> =
            points.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, p)| p.length()).collect();
        others.sort_by(f64::total_cmp);
        let typical = others.get(others.len() / 2).copied().unwrap_or(0.0);
        points[i].length() > least.max(OUTLIER_RATIO * typical)
    };
    (0..points.len()).map(|i| points.len() > 1 && far(i)).collect()
}

fn ends_in_motion(demonstration: &Demonstration) -> bool {
    let steps = demonstration.poses.windows(2);
    let steps: Vec<f64> = steps.map(|p| (p[1].position - p[0].position).length()).collect();
    let fastest = steps.iter().copied().fold(0.0, f64::max);
    let last = &steps[steps.len().saturating_sub(END_SAMPLES)..];
    last.iter().sum::<f64>() / last.len() as f64 > END_SPEED_FRACTION * fastest
}

/// An axis of rotation by name, or as numbers.
fn axis(rotation: DVec3) -> String {
    let unit = rotation.normalize_or_zero();
    let named = [("x", unit.x), ("y", unit.y), ("z", unit.z)];
    match named.iter().find(|(_, cosine)| cosine.abs() > ALONG_AXIS) {
        Some((name, cosine)) => format!("{}{name}", if *cosine < 0.0 { "−" } else { "" }),
        None => format!("({:.2}, {:.2}, {:.2})", unit.x, unit.y, unit.z),
    }
}
