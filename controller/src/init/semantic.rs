//! What XRDF and SRDF files know of an arm beside its URDF.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DVec3;
use nalgebra::SVector;
use thiserror::Error;
use tprmp_robot::Document;
use tprmp_spatial::Pose;

use crate::init::arm::Arm;
use crate::init::limits::Rates;
use crate::init::notes::Note;

/// Why such a file cannot be used.
#[derive(Debug, Error)]
#[error("`{file}`: {text}")]
pub struct SemanticError {
    /// The file.
    pub file: PathBuf,
    /// What was expected and found.
    pub text: String,
}

/// What the files say; empty without any.
#[derive(Debug, Clone, Default)]
pub(super) struct Semantic {
    /// The base's link.
    pub base: Option<String>,
    /// The tool's link.
    pub tool: Option<String>,
    /// The tool's frame in that link, where a file adds it: its name and its pose there.
    pub tool_frame: Option<(String, Pose)>,
    /// Spheres: link, centre in its frame \[m\], radius \[m\].
    pub spheres: Option<Vec<(String, DVec3, f64)>>,
    /// Pairs of links that need not keep clear of each other.
    pub ignored: Vec<(String, String)>,
    /// A posture by its name, joint by joint \[rad or m\].
    pub(super) home: BTreeMap<String, f64>,
    pub(super) home_name: String,
    /// The joints that move; all of them where there are none.
    pub(super) moved: Vec<String>,
    /// \[rad/s² or m/s²\]
    pub(super) acceleration: BTreeMap<String, f64>,
    /// \[rad/s³ or m/s³\]
    pub(super) jerk: BTreeMap<String, f64>,
    /// Links that must be there, with the key that names them, of a file that was not yet checked.
    pub(super) needed_links: Vec<(String, String)>,
    /// What was found in the files and is not used.
    pub(super) unused: Vec<String>,
    /// The file that the posture is from.
    pub(super) home_file: PathBuf,
}

impl Semantic {
    /// The posture that a file names \[rad or m\], within `ends`; `None` where there is none, or it does not have all
    /// joints.
    ///
    /// # Errors
    /// A joint is outside its limits.
    pub(super) fn home<const N: usize>(
        &self,
        joints: &[String; N],
        [lower, upper]: [&SVector<f64, N>; 2],
        ends: &[SVector<f64, N>; 2],
        notes: &mut Vec<Note>,
    ) -> Result<Option<SVector<f64, N>>, SemanticError> {
        if self.home.is_empty() {
            return Ok(None);
        }
        let mut home = SVector::<f64, N>::zeros();
        for (i, joint) in joints.iter().enumerate() {
            let Some(at) = self.home.get(joint) else {
                let text = format!(
                    "the posture `{}` does not say where `{joint}` is: it is not used",
                    self.home_name
                );
                notes.push(Note::lack(text));
                return Ok(None);
            };
            if !(lower[i]..=upper[i]).contains(at) {
                let (name, lower, upper) = (&self.home_name, lower[i], upper[i]);
                let text = format!(
                    "posture `{name}`: expected joint `{joint}` within [{lower}, {upper}], found {at}"
                );
                return Err(SemanticError { file: self.home_file.clone(), text });
            }
            home[i] = at.clamp(ends[0][i], ends[1][i]);
        }
        Ok(Some(home))
    }

    /// Looks for the links and joints that a file names; what is only to be ignored is left out where it is not there.
    ///
    /// # Errors
    /// All that the URDF does not have.
    pub(super) fn check(
        &mut self,
        document: &Document,
        file: &Path,
        notes: &mut Vec<Note>,
    ) -> Result<(), SemanticError> {
        let has_link = |name: &str| document.links.iter().any(|link| link.name == name);
        let has_joint = |name: &str| document.joints.iter().any(|joint| joint.name == name);
        let needed = self.needed_links.drain(..).filter(|(_, link)| !has_link(link));
        let mut wrong: Vec<String> = needed
            .map(|(key, link)| format!("{key}: expected a link of the URDF, found `{link}`"))
            .collect();
        wrong.extend(self.moved.iter().filter(|name| !has_joint(name)).map(|name| {
            format!("key `cspace.joint_names`: expected joints of the URDF, found `{name}`")
        }));
        if !wrong.is_empty() {
            let list = wrong.iter().map(|text| tprmp_files::printable(text)).collect::<Vec<_>>();
            return Err(SemanticError { file: file.to_owned(), text: list.join("; ") });
        }
        let before = self.ignored.len();
        self.ignored.retain(|(a, b)| has_link(a) && has_link(b));
        let gone = before - self.ignored.len();
        if gone > 0 {
            self.unused.push(format!(
                "{gone} pairs of links to ignore name links that the URDF does not have"
            ));
        }
        notes.extend(self.unused.drain(..).map(Note::lack));
        Ok(())
    }

    /// Where the posture comes from, and whether it is `used`.
    pub(super) fn home_reason(&self, used: bool) -> String {
        if used {
            format!("the posture `{}` of the file", self.home_name)
        } else {
            "far from singular configurations and from the joints' limits, clear, the tool down where it can".into()
        }
    }

    /// Holds the joints that a file places and does not move.
    pub(super) fn hold(&self, arm: &mut Arm) {
        for (joint, at) in &mut arm.held_joints {
            if let Some(given) = self.home.get(joint) {
                *at = *given;
            }
        }
        if self.moved.is_empty() {
            return;
        }
        let held: Vec<String> =
            arm.joints.iter().filter(|joint| !self.moved.contains(joint)).cloned().collect();
        arm.joints.retain(|joint| !held.contains(joint));
        for joint in held {
            let at = self.home.get(&joint).copied().unwrap_or(0.0);
            arm.held_joints.insert(joint, at);
        }
    }

    /// Puts the file's accelerations and jerks in the place of those that were found.
    pub(super) fn replace_rates<const N: usize>(&self, joints: &[String; N], rates: &mut Rates) {
        for (limits, found, reason) in [
            (&self.acceleration, &mut rates.acceleration, &mut rates.acceleration_reason),
            (&self.jerk, &mut rates.jerk, &mut rates.jerk_reason),
        ] {
            let all = joints.iter().map(|joint| limits.get(joint).copied());
            if let Some(all) = all.collect::<Option<Vec<_>>>() {
                *found = all;
                *reason = "of the XRDF".into();
            }
        }
    }
}
