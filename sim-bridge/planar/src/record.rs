//! The scripted expert: demonstrations of one stroke between frames that differ from time to time.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::fmt::Write;
use std::path::Path;

use glam::DVec2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::Deserialize;
use tprmp_files::{Draft, Existing, make_folder, outln};

use crate::error::{SimError, parse_json, read_text};
use crate::scene::{Range, Scene};
use crate::shape::{PlanarPose, Stroke, minimum_jerk};

/// Schema of a demonstration file.
const SCHEMA: &str = "tprmp-demonstration/1";
/// Waves of which the variation of a stroke is made.
const VARIATION_WAVES: usize = 3;

/// A demonstrated stroke and its frames, in `B`.
#[derive(Debug, Clone)]
pub(crate) struct Demonstration {
    /// The start frame; the stroke starts at its origin. What is fixed to the goal frame alone has that one.
    pub(crate) start: PlanarPose,
    /// The goal frame; the stroke ends at its origin.
    pub(crate) goal: PlanarPose,
    /// Positions \[m\], one a sampling time.
    pub(crate) points: Vec<DVec2>,
}

impl Demonstration {
    /// The demonstration laid between other frames, as the expert lays a stroke: its start moves with the
    /// start frame, its end with the goal frame \[m\].
    pub(crate) fn between(&self, start: &PlanarPose, goal: &PlanarPose) -> Vec<DVec2> {
        let last = self.points.len().max(2) - 1;
        let point = |(i, point): (usize, &DVec2)| {
            let with_start = start.transform(self.start.inverse_transform(*point));
            let with_goal = goal.transform(self.goal.inverse_transform(*point));
            if self.start == self.goal {
                return with_goal;
            }
            with_start.lerp(with_goal, minimum_jerk(i as f64 / last as f64))
        };
        self.points.iter().enumerate().map(point).collect()
    }
}

/// What the expert varies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Variation {
    /// Demonstrations.
    pub(crate) count: u32,
    pub(crate) duration_s: Range,
    pub(crate) sampling_time_s: f64,
    /// Of either frame, to either side, in x and y.
    pub(crate) position_variation_m: f64,
    /// Of either frame, to either side.
    pub(crate) angle_variation_rad: f64,
    /// Of the stroke between its ends, to either side.
    pub(crate) shape_variation_m: f64,
}

/// What a demonstration file holds beside the motion.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Labels<'a> {
    pub(crate) skill: &'a str,
    pub(crate) start_frame: &'a str,
    pub(crate) goal_frame: &'a str,
    pub(crate) sampling_time_s: f64,
}

/// Records the demonstrations of a scene into a folder.
pub(crate) fn record(
    scene: &Scene,
    seed: u64,
    out: &Path,
    existing: Existing,
) -> Result<(), SimError> {
    write_all(&of_scene(scene, seed), &labels(scene), out, existing)
}

/// Writes demonstrations into a folder: 01.json, 02.json, …; all, or none when one may not be.
pub(crate) fn write_all(
    demonstrations: &[Demonstration],
    labels: &Labels,
    out: &Path,
    existing: Existing,
) -> Result<(), SimError> {
    make_folder(out)?;
    let mut drafts = Vec::with_capacity(demonstrations.len());
    for (i, demonstration) in demonstrations.iter().enumerate() {
        let path = out.join(format!("{:02}.json", i + 1));
        let mut draft = Draft::open(&path, existing)?;
        draft.put(to_text(demonstration, labels))?;
        drafts.push((path, draft));
    }
    for ((path, draft), demonstration) in drafts.into_iter().zip(demonstrations) {
        draft.keep()?;
        outln!(
            "{}: {} samples, {:.2} s",
            path.display(),
            demonstration.points.len(),
            (demonstration.points.len() - 1) as f64 * labels.sampling_time_s
        );
    }
    Ok(())
}

fn labels(scene: &Scene) -> Labels<'_> {
    Labels {
        skill: &scene.task.skill,
        start_frame: &scene.task.start_frame,
        goal_frame: &scene.task.goal_frame,
        sampling_time_s: scene.record.sampling_time_s,
    }
}

/// The expert's demonstrations of a scene's stroke with this seed.
fn of_scene(scene: &Scene, seed: u64) -> Vec<Demonstration> {
    let settings = &scene.record;
    let variation = Variation {
        count: settings.count,
        duration_s: settings.duration_s,
        sampling_time_s: settings.sampling_time_s,
        position_variation_m: settings.position_variation_m,
        angle_variation_rad: settings.angle_variation_rad,
        shape_variation_m: settings.shape_variation_m,
    };
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    demonstrate(&Stroke::lying_s(settings), &variation, &mut generator, minimum_jerk)
}

/// Demonstrates a stroke between frames that differ from time to time; `progress` is the fraction of its
/// length at a fraction of the duration.
pub(crate) fn demonstrate(
    stroke: &Stroke,
    settings: &Variation,
    generator: &mut ChaCha8Rng,
    progress: impl Fn(f64) -> f64,
) -> Vec<Demonstration> {
    let shift = Range::around_zero(settings.position_variation_m);
    let rotation = Range::around_zero(settings.angle_variation_rad);
    let wave = Range::around_zero(settings.shape_variation_m / VARIATION_WAVES as f64);
    (0..settings.count)
        .map(|_| {
            let mut frame = |position: DVec2| PlanarPose {
                position_m: position + DVec2::new(shift.draw(generator), shift.draw(generator)),
                angle_rad: rotation.draw(generator),
            };
            let (start, goal) = (frame(stroke.start()), frame(stroke.end()));
            let waves: [DVec2; VARIATION_WAVES] =
                std::array::from_fn(|_| DVec2::new(wave.draw(generator), wave.draw(generator)));
            let steps = settings.duration_s.draw(generator) / settings.sampling_time_s;
            let steps = steps.round() as usize;
            let point = |i: usize| {
                let fraction = progress(i as f64 / steps as f64);
                stroke.between(&start, &goal, fraction) + variation(&waves, fraction)
            };
            Demonstration { start, goal, points: (0..=steps).map(point).collect() }
        })
        .collect()
}

/// A smooth deviation that leaves both ends, and the direction there, as they are \[m\].
fn variation(waves: &[DVec2; VARIATION_WAVES], fraction: f64) -> DVec2 {
    let envelope = (PI * fraction).sin().powi(2);
    let wave =
        |(k, amplitude): (usize, &DVec2)| *amplitude * (PI * (k + 1) as f64 * fraction).cos();
    envelope * waves.iter().enumerate().map(wave).sum::<DVec2>()
}

fn to_text(demonstration: &Demonstration, labels: &Labels) -> String {
    let frame = |pose: &PlanarPose| {
        let (p, q) = (pose.position_m, pose.quaternion_wxyz());
        format!(
            "{{\"position_m\": [{:.6}, {:.6}, 0.0], \
             \"quaternion_wxyz\": [{:.6}, 0.0, 0.0, {:.6}]}}",
            p.x, p.y, q[0], q[3]
        )
    };
    let quoted = |text: &str| serde_json::Value::from(text).to_string();
    let mut text = format!(
        "{{\n\"schema\": \"{SCHEMA}\",\n\"skill\": {},\n\"manifold\": \"R2\",\n\
         \"sampling_time_s\": {},\n\"frames\": {{\n{}: {},\n{}: {}\n}},\n\
         \"columns\": [\"x_m\", \"y_m\"],\n\"samples\": [\n",
        quoted(labels.skill),
        labels.sampling_time_s,
        quoted(labels.start_frame),
        frame(&demonstration.start),
        quoted(labels.goal_frame),
        frame(&demonstration.goal),
    );
    for (i, p) in demonstration.points.iter().enumerate() {
        let comma = if i + 1 == demonstration.points.len() { "" } else { "," };
        writeln!(text, "[{:.6}, {:.6}]{comma}", p.x, p.y).expect("a string grows");
    }
    text.push_str("]\n}\n");
    text
}

#[derive(Deserialize)]
struct File {
    frames: BTreeMap<String, FileFrame>,
    samples: Vec<[f64; 2]>,
}

#[derive(Deserialize)]
struct FileFrame {
    position_m: [f64; 3],
    quaternion_wxyz: [f64; 4],
}

/// Reads the demonstrations of a folder, for a picture: the learner is the one who checks them.
pub(crate) fn read_folder(folder: &Path, scene: &Scene) -> Result<Vec<Demonstration>, SimError> {
    let unreadable = |source| SimError::Read { path: folder.into(), source, hint: "" };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        paths.push(entry.map_err(unreadable)?.path());
    }
    paths.retain(|path| path.extension().is_some_and(|e| e == "json"));
    paths.sort();
    paths.iter().map(|path| read(path, scene)).collect()
}

fn read(path: &Path, scene: &Scene) -> Result<Demonstration, SimError> {
    let file: File = parse_json(&read_text(path, "")?, path)?;
    let frame = |name: &str| {
        let frame = file.frames.get(name).ok_or_else(|| {
            SimError::key(path, format!("frames.{name}"), "expected this frame, found none")
        })?;
        let [w, _, _, z] = frame.quaternion_wxyz;
        Ok::<_, SimError>(PlanarPose {
            position_m: DVec2::new(frame.position_m[0], frame.position_m[1]),
            angle_rad: 2.0 * z.atan2(w),
        })
    };
    let goal = frame(&scene.task.goal_frame)?;
    let has_start = file.frames.contains_key(scene.task.start_frame.as_str());
    Ok(Demonstration {
        start: if has_start { frame(&scene.task.start_frame)? } else { goal },
        goal,
        points: file.samples.iter().map(|p| DVec2::from(*p)).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::tests::scene;

    #[test]
    fn demonstrations_join_their_frames_at_rest() {
        let scene = scene();
        let demonstrations = of_scene(&scene, 1);
        assert_eq!(demonstrations.len(), scene.record.count as usize);
        for d in &demonstrations {
            let last = d.points.len() - 1;
            assert!((d.points[0] - d.start.position_m).length() < 1e-12);
            assert!((d.points[last] - d.goal.position_m).length() < 1e-12);
            let speed =
                |i: usize| (d.points[i + 1] - d.points[i]).length() / scene.record.sampling_time_s;
            assert!(speed(0) < 0.01 && speed(last - 1) < 0.01);
            assert!((3.0..=301.0).contains(&(d.points.len() as f64)));
        }
    }

    #[test]
    fn a_demonstration_between_other_frames_joins_them() {
        let d = &of_scene(&scene(), 1)[0];
        let own = d.between(&d.start, &d.goal);
        assert!(own.iter().zip(&d.points).all(|(a, b)| (*a - *b).length() < 1e-12));
        let start = PlanarPose { position_m: DVec2::new(-1.0, 0.3), angle_rad: 0.2 };
        let goal = PlanarPose { position_m: DVec2::new(1.4, -0.1), angle_rad: -0.3 };
        let moved = d.between(&start, &goal);
        assert!((moved[0] - start.position_m).length() < 1e-12);
        assert!((moved[moved.len() - 1] - goal.position_m).length() < 1e-12);
    }

    #[test]
    fn a_seed_determines_all_and_what_was_written_can_be_read() {
        let scene = scene();
        let texts = |seed| -> Vec<String> {
            of_scene(&scene, seed).iter().map(|d| to_text(d, &labels(&scene))).collect()
        };
        assert_eq!(texts(3), texts(3));
        assert_ne!(texts(3), texts(4));
        let folder = std::env::temp_dir().join(format!("planar-record-{}", std::process::id()));
        record(&scene, 3, &folder, Existing::Keep).unwrap();
        let read = read_folder(&folder, &scene).unwrap();
        for (a, b) in read.iter().zip(of_scene(&scene, 3)) {
            assert!((a.goal.angle_rad - b.goal.angle_rad).abs() < 1e-5);
            let pairs = a.points.iter().zip(&b.points);
            assert!(pairs.into_iter().all(|(a, b)| (*a - *b).length() < 1e-6));
        }
        std::fs::remove_dir_all(folder).unwrap();
    }
}
