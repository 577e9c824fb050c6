//! From rows of numbers, whatever they were read from, to a recording.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DQuat, DVec3};
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use super::clock::{Clock, Stamp};
use super::columns::{Channel, Columns, Tool, Wrong};
use super::frames::{FrameFile, Frames, closed_where, first_closing};
use super::joints::Joints;
use super::recording::Recording;
use super::rows::{pose_of, vector_of};
use super::selection::{Selection, TimeUnit};
use crate::demonstration::{Grip, Gripper, check_width};
use crate::file_error::FileError;

/// What is wrong with the quaternion of a row is said at this column.
const QUATERNION: &str = "qw";

/// Rows that are read one after the other.
pub(super) struct Samples<'a> {
    columns: &'a Columns,
    joints: Option<&'a mut Joints>,
    selection: &'a Selection,
    clock: Clock,
    times_s: Vec<f64>,
    poses: Vec<Pose>,
    velocities: Vec<DVec3>,
    gripper: Vec<f64>,
    channel: Vec<f64>,
    /// Frames at the first row.
    frames: BTreeMap<String, Pose>,
}

impl<'a> Samples<'a> {
    pub(super) fn new(
        columns: &'a Columns,
        joints: Option<&'a mut Joints>,
        selection: &'a Selection,
    ) -> Self {
        let unit = columns.time.map_or(TimeUnit::S, |(_, unit)| unit);
        Self {
            columns,
            joints,
            selection,
            clock: Clock::new(unit, selection.time_unit),
            times_s: Vec::new(),
            poses: Vec::new(),
            velocities: Vec::new(),
            gripper: Vec::new(),
            channel: Vec::new(),
            frames: BTreeMap::new(),
        }
    }

    /// So many rows were read.
    pub(super) fn len(&self) -> usize {
        self.poses.len()
    }

    /// Adds a row: its time, and its finite numbers by the indices of their columns.
    pub(super) fn push(
        &mut self,
        stamp: Stamp,
        number: impl Fn(usize) -> Result<f64, Wrong>,
    ) -> Result<(), Wrong> {
        let numbers =
            |columns: &[usize]| columns.iter().map(|i| number(*i)).collect::<Result<_, _>>();
        let length_m = self.selection.length_m();
        let time_s = self.clock.seconds(stamp).map_err(|problem| ("time_s".into(), problem))?;
        let pose = match &self.columns.tool {
            Tool::Pose(columns) => {
                let row: Vec<f64> = numbers(columns)?;
                pose_of(&row, length_m).map_err(|problem| (QUATERNION.into(), problem))?
            }
            Tool::Joints(columns) => {
                let row: Vec<f64> = numbers(columns)?;
                let joints = self.joints.as_mut().expect("only a robot has columns of joints");
                within(self.columns.manifold, joints.tool_pose(&row)?)
            }
        };
        if let Some(columns) = &self.columns.velocity {
            let velocity: Vec<f64> = numbers(columns)?;
            self.velocities.push(vector_of(&velocity) * length_m);
        }
        if let Some(column) = self.columns.gripper {
            self.gripper.push(number(column)?);
        }
        match self.columns.channel {
            Some(Channel::Grips(column)) => {
                let value = check_grip(number(column)?);
                self.channel.push(value.map_err(|problem| ("gripper".into(), problem))?);
            }
            Some(Channel::Widths(column)) => {
                let width_m = check_width(Some(number(column)? * length_m));
                self.channel.push(width_m.map_err(|problem| ("gripper_width_m".into(), problem))?);
            }
            Some(Channel::Positions(_)) | None => {}
        }
        if self.poses.is_empty() {
            for (name, columns) in &self.columns.frames {
                let row: Vec<f64> = numbers(columns)?;
                let pose = frame_of(&row, self.columns.manifold, length_m);
                let wrong = |problem| (format!("{name}.{QUATERNION}"), problem);
                self.frames.insert(name.clone(), pose.map_err(wrong)?);
            }
        }
        self.times_s.push(time_s);
        self.poses.push(pose);
        Ok(())
    }

    /// The recording of all rows; `i` is its number in the file of frames.
    pub(super) fn finish(
        self,
        path: &Path,
        place: &str,
        file: Option<(&FrameFile, usize)>,
    ) -> Result<Recording, FileError> {
        let manifold = self.columns.manifold;
        let mut notes: Vec<String> = self.joints.iter().map(|joints| joints.note.clone()).collect();
        notes.extend(self.clock.note());
        let mut frames = Frames::new(manifold);
        for (name, pose) in self.frames {
            notes.push(format!("frame {name} of columns, at the start"));
            frames.add(name, pose, path)?;
        }
        if let (Some(name), Some(closed)) =
            (&self.selection.frame_at_closing, self.selection.closed)
        {
            let column = self.selection.gripper_column();
            let fail =
                |problem| FileError::input(path, format!("{place}, column `{column}`"), problem);
            let i = first_closing(&self.gripper, closed).map_err(fail)?;
            notes.push(format!("frame {name} where the gripper closes first, sample {i}"));
            frames.add(name.clone(), self.poses[i], path)?;
        }
        let gripper = match (self.columns.channel, self.selection.closed) {
            (Some(Channel::Grips(_)), _) => Some(Gripper::Grips(grips_of(&self.channel))),
            (Some(Channel::Widths(_)), _) => Some(Gripper::Widths(self.channel)),
            (Some(Channel::Positions(_)), Some(closed)) => {
                closed_where(&self.gripper, closed).map(Gripper::Grips)
            }
            (Some(Channel::Positions(_)) | None, _) => None,
        };
        notes.extend(gripper.as_ref().map(gripper_note));
        if gripper.is_none() && self.columns.channel.is_some() {
            notes.push("the gripper does not move".into());
        }
        let may_begin = file.is_none() || self.joints.is_some();
        let first = self.poses.first().filter(|_| may_begin);
        let (start, goal_frame, other_frames) =
            frames.finish(path, file, first, self.selection, &mut notes)?;
        Ok(Recording {
            place: place.into(),
            manifold,
            start,
            goal_frame,
            other_frames,
            times_s: self.times_s,
            poses: self.poses,
            velocities: self.columns.velocity.is_some().then_some(self.velocities),
            gripper,
            notes,
            ignored: self.columns.ignored_text(),
            has_own_unit: false,
        })
    }
}

/// A number of a column `gripper`.
pub(super) fn check_grip(value: f64) -> Result<f64, String> {
    if value == 0.0 || value == 1.0 {
        return Ok(value);
    }
    Err(format!(
        "expected `open`, `closed`, 0 (open) or 1 (closed), found {value}; --closed low or high reads positions \
         of a gripper, --ignore gripper leaves it out"
    ))
}

/// Of numbers that are 0 or 1.
pub(super) fn grips_of(values: &[f64]) -> Vec<Grip> {
    values.iter().map(|value| if *value == 0.0 { Grip::Open } else { Grip::Closed }).collect()
}

/// What was read of the gripper.
pub(super) fn gripper_note(gripper: &Gripper) -> String {
    match gripper {
        Gripper::Grips(grips) => {
            let closed = grips.iter().filter(|grip| **grip == Grip::Closed).count();
            format!("gripper closed in {closed} samples of {}", grips.len())
        }
        Gripper::Widths(widths_m) => {
            let least = widths_m.iter().copied().fold(f64::INFINITY, f64::min);
            let greatest = widths_m.iter().copied().fold(0.0, f64::max);
            format!("gripper {:.1} to {:.1} mm wide", 1e3 * least, 1e3 * greatest)
        }
    }
}

/// A pose of a robot's tool within the space of a skill.
fn within(manifold: Manifold, pose: Pose) -> Pose {
    let DVec3 { x, y, z } = pose.position;
    match manifold {
        Manifold::R2 => Pose { position: DVec3::new(x, y, 0.0), orientation: DQuat::IDENTITY },
        Manifold::R3 => Pose { position: DVec3::new(x, y, z), orientation: DQuat::IDENTITY },
        Manifold::R3S1 | Manifold::S3 | Manifold::R3S3 => pose,
    }
}

/// The frame of its columns' numbers: positions of the manifold, and the quaternion where there is one.
fn frame_of(row: &[f64], manifold: Manifold, length_m: f64) -> Result<Pose, String> {
    let (position, quaternion) = row.split_at(manifold.position_dimension());
    let mut all = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
    all[..position.len()].copy_from_slice(position);
    if !quaternion.is_empty() {
        all[3..].copy_from_slice(quaternion);
    }
    let pose = pose_of(&all, length_m)?;
    if manifold == Manifold::R2 && pose.orientation.x.hypot(pose.orientation.y) > 1e-3 {
        return Err("expected a rotation about z for a planar skill".into());
    }
    Ok(pose)
}
