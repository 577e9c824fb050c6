//! Which column of a table is what. Columns are known by their exact names; one that is nearly known is
//! refused, and what is not known is listed.

use std::collections::BTreeMap;

use tprmp_model::skill_model::Manifold;

use super::names::{bare, nearly};
use super::selection::{AngleUnit, LengthUnit, Selection, Space, TimeUnit};
use crate::demonstration::columns;

/// A column that is wrong, and what was expected.
pub(super) type Wrong = (String, String);

/// Names of positions, with the number that a pose has there.
const AXES: [&str; 3] = ["x", "y", "z"];
const QUATERNION: [&str; 4] = ["qw", "qx", "qy", "qz"];
/// Name of the column that says whether the gripper is open.
const GRIPPER: &str = "gripper";
/// Most frames in columns.
const FRAMES_MAX: usize = 100;
/// So many names that are not known are listed.
const IGNORED_LISTED: usize = 8;

/// Where the pose of the tool comes from: indices of columns.
#[derive(Debug)]
pub(super) enum Tool {
    /// Its coordinates, in order of the manifold's columns.
    Pose(Vec<usize>),
    /// The joints of a robot, in its order.
    Joints(Vec<usize>),
}

/// A column of the gripper's channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channel {
    /// Words, or 0 for open and 1 for closed.
    Grips(usize),
    /// Widths \[m\], or in the unit of positions.
    Widths(usize),
    /// Positions, closed at the end that `--closed` says.
    Positions(usize),
}

/// The columns of a table by their meaning: indices among its names.
#[derive(Debug)]
pub(super) struct Columns {
    pub(super) manifold: Manifold,
    /// Times, and their unit by the column's name.
    pub(super) time: Option<(usize, TimeUnit)>,
    pub(super) tool: Tool,
    /// Linear velocities of the tool, when all of the manifold are there.
    pub(super) velocity: Option<Vec<usize>>,
    /// Frames by name: positions of the manifold, then the quaternion where there is one.
    pub(super) frames: BTreeMap<String, Vec<usize>>,
    /// The column of the gripper's position that `--closed` judges.
    pub(super) gripper: Option<usize>,
    /// What the channel of the gripper is read from.
    pub(super) channel: Option<Channel>,
    /// Names of columns that are not read.
    pub(super) ignored: Vec<String>,
}

impl Columns {
    /// Finds the columns; `joints` are the names of the robot's joints when there is one. Times may have to
    /// be among them, and a column `gripper` may say open or closed.
    pub(super) fn find(
        names: &[String],
        joints: Option<&[String]>,
        needs_time: bool,
        has_words: bool,
        selection: &Selection,
    ) -> Result<Self, Wrong> {
        let finder = Finder { names, selection, has_words };
        finder.check_twice()?;
        let time = finder.time()?;
        if needs_time && time.is_none() {
            let expected = joints.map_or("x_m, y_m, z_m, qw, qx, qy, qz".into(), |j| j.join(", "));
            return Err(finder.missing("time_s", &expected));
        }
        let (manifold, tool) = match joints {
            Some(joints) => finder.joints(joints)?,
            None => finder.pose()?,
        };
        let mut found = Self {
            manifold,
            time,
            tool,
            velocity: finder.velocity(manifold),
            frames: finder.frames(manifold)?,
            gripper: finder.gripper()?,
            channel: None,
            ignored: Vec::new(),
        };
        found.channel = finder.channel(found.gripper)?;
        let unread: Vec<usize> = (0..names.len()).filter(|i| !found.uses(*i)).collect();
        for i in unread {
            finder.refuse_nearly_known(&names[i], joints.unwrap_or_default(), &found)?;
            found.ignored.push(names[i].clone());
        }
        Ok(found)
    }

    fn uses(&self, i: usize) -> bool {
        self.indices().any(|used| used == i)
    }

    /// All columns that are read.
    pub(super) fn indices(&self) -> impl Iterator<Item = usize> + '_ {
        let (Tool::Pose(tool) | Tool::Joints(tool)) = &self.tool;
        let time = self.time.iter().map(|(i, _)| i);
        let others = self.velocity.iter().chain(self.frames.values()).flatten();
        let channel = self.channel.as_ref().map(|channel| match channel {
            Channel::Grips(i) | Channel::Widths(i) | Channel::Positions(i) => i,
        });
        tool.iter().chain(time).chain(others).chain(&self.gripper).chain(channel).copied()
    }

    /// The ignored columns as a list for people; `None` when there are none.
    pub(super) fn ignored_text(&self) -> Option<String> {
        if self.ignored.is_empty() {
            return None;
        }
        let listed = self.ignored.iter().take(IGNORED_LISTED);
        let names: Vec<&str> =
            listed.map(|name| if name.is_empty() { "(no name)" } else { name.as_str() }).collect();
        let more = match self.ignored.len().saturating_sub(IGNORED_LISTED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        Some(format!("ignored: {}{more}", names.join(", ")))
    }
}

struct Finder<'a> {
    names: &'a [String],
    selection: &'a Selection,
    /// Whether a column `gripper` says open or closed; otherwise it is whatever a robot's state holds.
    has_words: bool,
}

impl Finder<'_> {
    /// The column of a name, unless it is to be left out.
    fn at(&self, name: &str) -> Option<usize> {
        let found = self.names.iter().position(|other| other == name);
        found.filter(|_| !self.is_ignored(name))
    }

    fn is_ignored(&self, name: &str) -> bool {
        self.selection.ignore.iter().any(|ignored| ignored == name)
    }

    fn check_twice(&self) -> Result<(), Wrong> {
        let mut before = std::collections::HashSet::new();
        match self.names.iter().find(|name| !name.is_empty() && !before.insert(name.as_str())) {
            Some(twice) => Err((twice.clone(), "expected it once, found it again".into())),
            None => Ok(()),
        }
    }

    /// A coordinate, `x` for example, behind a prefix: in metres, or in millimetres when those were
    /// asked for.
    fn coordinate(&self, prefix: &str, axis: &str, per_second: &str) -> Option<usize> {
        let millimetres = self.selection.unit == Some(LengthUnit::Mm);
        let name = |unit: &str| self.at(&format!("{prefix}{axis}_{unit}{per_second}"));
        name("m").or_else(|| if millimetres { name("mm") } else { None })
    }

    /// The manifold of the pose's columns, and these.
    fn pose(&self) -> Result<(Manifold, Tool), Wrong> {
        let place = |column: &str| match column.strip_suffix("_m") {
            Some(axis) => self.coordinate("", axis, ""),
            None => self.at(column),
        };
        let has_some = |names: &[&str]| names.iter().any(|name| place(name).is_some());
        let recorded = match (has_some(&QUATERNION), has_some(&["z_m"])) {
            (true, _) => Manifold::R3S3,
            (_, true) => Manifold::R3,
            _ => Manifold::R2,
        };
        let manifold = self.selection.space.map_or(recorded, Space::manifold);
        let find = |column: &&str| {
            place(column).ok_or_else(|| self.missing(column, &columns(manifold).join(", ")))
        };
        let found = columns(manifold).iter().map(find).collect::<Result<_, _>>()?;
        Ok((manifold, Tool::Pose(found)))
    }

    /// The refusal of a table without a column.
    fn missing(&self, column: &str, expected: &str) -> Wrong {
        // As LeRobot names a joint.
        let element = format!("{}_pos", column.strip_suffix("_joint").unwrap_or(column));
        let known = [column, &*element];
        let nearly = self.names.iter().find(|name| nearly(name, &known).is_some());
        let hint = match nearly {
            Some(found) if found.ends_with("_mm") => {
                format!("; `{found}` is read with --unit mm")
            }
            Some(found) if found.ends_with("_deg") => {
                format!("; `{found}` is read with --joint-unit deg")
            }
            Some(found) => format!("; rename `{found}`, if that is it"),
            None if self.names.len() < 2 => "; columns are separated by `,`, `;` or tabs".into(),
            None if self.selection.robot.is_none() && column != "time_s" => {
                "; joints are read with --robot".into()
            }
            None => String::new(),
        };
        let found = tprmp_files::shortened(&self.names.join(", "));
        (column.into(), format!("expected a header with time_s, {expected}, found {found}{hint}"))
    }

    /// The joints of a robot, each by its name, alone or with a unit, or with `.pos` as LeRobot names
    /// them.
    fn joints(&self, joints: &[String]) -> Result<(Manifold, Tool), Wrong> {
        let find = |joint: &String| {
            let short = joint.strip_suffix("_joint").unwrap_or(joint);
            let degrees = self.selection.joint_unit == Some(AngleUnit::Deg);
            let unit = if degrees { "deg" } else { "rad" };
            let plain = [joint.clone(), format!("{joint}_{unit}"), format!("{joint}_m")];
            let spellings =
                [&plain[..], &[format!("{joint}.pos"), format!("{short}.pos")]].concat();
            let found: Vec<usize> = spellings.iter().filter_map(|name| self.at(name)).collect();
            match found[..] {
                [one] => Ok(one),
                [] => Err(self.missing(joint, &joints.join(", "))),
                [..] => Err((joint.clone(), "expected this joint once, found it again".into())),
            }
        };
        let found = joints.iter().map(find).collect::<Result<_, _>>()?;
        let manifold = self.selection.space.map_or(Manifold::R3S3, Space::manifold);
        Ok((manifold, Tool::Joints(found)))
    }

    fn time(&self) -> Result<Option<(usize, TimeUnit)>, Wrong> {
        let units = [TimeUnit::S, TimeUnit::Ms, TimeUnit::Us, TimeUnit::Ns];
        let times = units.into_iter().filter_map(|unit| {
            let name = format!("time_{}", unit.suffix());
            Some((self.at(&name)?, unit))
        });
        match times.collect::<Vec<_>>()[..] {
            [] => Ok(None),
            [one] => Ok(Some(one)),
            [_, (other, _), ..] => {
                let problem =
                    "expected one column of times, found another; leave one out by --ignore";
                Err((self.names[other].clone(), problem.into()))
            }
        }
    }

    /// Linear velocities, when all of the manifold are there.
    fn velocity(&self, manifold: Manifold) -> Option<Vec<usize>> {
        let axes = AXES.iter().take(manifold.position_dimension());
        axes.map(|axis| self.coordinate("v", axis, "_s")).collect()
    }

    /// `NAME.x_m` and so on.
    fn frames(&self, manifold: Manifold) -> Result<BTreeMap<String, Vec<usize>>, Wrong> {
        let is_component = |part: &str| {
            QUATERNION.contains(&part)
                || AXES.iter().any(|axis| {
                    part.strip_prefix(axis).is_some_and(|rest| ["_m", "_mm"].contains(&rest))
                })
        };
        let split = |name: &String| {
            let (frame, part) = name.rsplit_once('.')?;
            (is_component(part) && !frame.is_empty()).then(|| frame.to_owned())
        };
        let names: std::collections::BTreeSet<String> = {
            let read = self.names.iter().filter(|name| !self.is_ignored(name));
            read.filter_map(split).collect()
        };
        if names.len() > FRAMES_MAX {
            let problem = format!("expected at most {FRAMES_MAX} frames, found {}", names.len());
            return Err((names.into_iter().next().unwrap_or_default(), problem));
        }
        names.into_iter().map(|name| Ok((name.clone(), self.frame(&name, manifold)?))).collect()
    }

    /// Columns of a frame; the orientation may be left out where the tool has none.
    fn frame(&self, name: &str, manifold: Manifold) -> Result<Vec<usize>, Wrong> {
        let need = |part: &str, at: Option<usize>| {
            let all = "x_m, y_m, z_m, qw, qx, qy, qz";
            let problem = format!("expected all columns of the frame `{name}`: {all}");
            at.ok_or_else(|| (format!("{name}.{part}"), problem))
        };
        let axes = AXES.iter().take(manifold.position_dimension());
        let mut found = axes
            .map(|axis| need(&format!("{axis}_m"), self.coordinate(&format!("{name}."), axis, "")))
            .collect::<Result<Vec<_>, _>>()?;
        let quaternion = QUATERNION.map(|part| (part, self.at(&format!("{name}.{part}"))));
        if manifold.has_orientation() || quaternion.iter().any(|(_, at)| at.is_some()) {
            for (part, at) in quaternion {
                found.push(need(part, at)?);
            }
        }
        Ok(found)
    }

    /// The gripper's position, where the options ask for it.
    fn gripper(&self) -> Result<Option<usize>, Wrong> {
        if self.selection.closed.is_none() {
            return Ok(None);
        }
        let name = self.selection.gripper_column();
        let found = self.at(name).or_else(|| self.at(&format!("{name}.pos")));
        let problem = || {
            let found = tprmp_files::shortened(&self.names.join(", "));
            format!("expected the gripper's column, found {found}; --gripper names another")
        };
        found.map(Some).ok_or_else(|| (name.into(), problem()))
    }

    /// The column of the gripper's channel: the one of its position, or else one that says by its name what
    /// it is.
    fn channel(&self, position: Option<usize>) -> Result<Option<Channel>, Wrong> {
        let width = self.coordinate("gripper_width", "", "");
        let word = self.at(GRIPPER).filter(|_| self.has_words);
        match (width, position, word) {
            (Some(width), Some(position), _) if position == width => {
                Ok(Some(Channel::Widths(width)))
            }
            (Some(width), Some(other), _) | (Some(width), None, Some(other)) => {
                let (width, other) = (&self.names[width], &self.names[other]);
                let problem = format!(
                    "expected one column of the gripper, found `{other}` too; leave one out by --ignore"
                );
                Err((width.clone(), problem))
            }
            (Some(width), None, None) => Ok(Some(Channel::Widths(width))),
            (None, Some(position), _) => Ok(Some(Channel::Positions(position))),
            (None, None, word) => Ok(word.map(Channel::Grips)),
        }
    }

    /// A column that is not read, and differs from one that is looked for by case, unit or separators.
    fn refuse_nearly_known(
        &self,
        name: &str,
        joints: &[String],
        found: &Columns,
    ) -> Result<(), Wrong> {
        // What was left out on purpose, or has its exact column beside it.
        let space = self.selection.space.map(Space::manifold);
        let (frame, part) = match name.rsplit_once('.') {
            Some((frame, part)) if found.frames.contains_key(frame) => (format!("{frame}."), part),
            _ => (String::new(), name),
        };
        let mut known = vec!["time_s", "gripper_width_m"];
        if joints.is_empty() {
            known.extend(match space {
                Some(manifold) => columns(manifold),
                None => columns(Manifold::R3S3),
            });
            known.extend(["vx_m_s", "vy_m_s", "vz_m_s"]);
        } else {
            known.extend(joints.iter().map(String::as_str));
        }
        let Some(like) = nearly(part, &known) else { return Ok(()) };
        let like = format!("{frame}{like}");
        if self.is_ignored(name) || found.reads(&like, self.names) {
            return Ok(());
        }
        let hint = if name.ends_with("_mm") { ", read millimetres with --unit mm" } else { "" };
        let problem = format!(
            "it looks like `{like}`, and would be left out: rename it to that{hint}, or leave it out by \
             --ignore {name}"
        );
        Err((name.into(), problem))
    }
}

impl Columns {
    /// Whether what a known name means is read, under this name or with another unit.
    fn reads(&self, known: &str, names: &[String]) -> bool {
        let is_time = known == "time_s" && self.time.is_some();
        let is_same = |i: usize| bare(&names[i]) == bare(known);
        is_time || self.indices().any(is_same)
    }
}
