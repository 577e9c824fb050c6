//! Which chain of a URDF is the arm: its base, its tool, and the joints beside it.

use std::collections::BTreeMap;

use tprmp_robot::Document;
use tprmp_robot::document::{Joint, JointType};

use crate::init::notes::Note;

/// A branch below an arm moves so many joints one after the other, or fewer: fingers. More make up an arm.
const FINGER_JOINTS_MAX: usize = 3;
/// Links and joints that have these in their names belong to a gripper.
const GRIPPER_WORDS: [&str; 6] = ["gripper", "finger", "jaw", "claw", "knuckle", "hand_joint"];
/// Names of frames at the end of an arm, those farther out first.
const TOOL_WORDS: [&str; 9] =
    ["tcp", "grasp", "tip", "tool0", "ee_link", "tool", "flange", "end", "ee"];

/// The arm of a description.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Arm {
    /// `None` for the root.
    pub base_link: Option<String>,
    /// Link at its end.
    pub tool_link: String,
    /// The joints between them that move, in order.
    pub joints: Vec<String>,
    /// Joints beside them, and where they are held \[rad or m\].
    pub held_joints: BTreeMap<String, f64>,
}

/// What is asked for.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Asked<'a> {
    /// Link that is the base.
    pub base: Option<&'a str>,
    /// Link that is the tool.
    pub tool: Option<&'a str>,
    /// Who asks for the tool.
    pub why: &'a str,
    /// Link that a model was learned for: the tool where the description has it.
    pub model_tool: Option<&'a str>,
}

/// Finds the arm.
///
/// The base is the root, or the first link below a joint that floats. From there the arm goes on while one
/// branch moves, or one of several is longer than fingers are. The tool is the link there, or a frame fixed to it
/// that is named like one.
///
/// # Errors
/// Nothing moves, or there are several arms and no tool was asked for: with what was expected and found.
pub(super) fn find(
    document: &Document,
    asked: Asked<'_>,
    notes: &mut Vec<Note>,
) -> Result<Arm, String> {
    let tree = Tree { document };
    tree.check()?;
    for (option, name) in [("--tool", asked.tool), ("--base", asked.base)] {
        if let Some(name) = name.filter(|name| !tree.has(name)) {
            let links = document.links.iter().map(|link| format!("`{}`", link.name));
            let links = links.collect::<Vec<_>>().join(", ");
            let links = tprmp_files::shortened(&links);
            return Err(format!("{option}: expected one of its links {links}, found `{name}`"));
        }
    }
    let root =
        tree.root().ok_or_else(|| "expected one link that is no joint's child".to_owned())?;
    let base = asked.base.map_or_else(|| tree.below_floating(root), str::to_owned);
    let known = asked.tool.or(asked.model_tool.filter(|name| tree.has(name)));
    let tool = match known {
        Some(tool) => tool.to_owned(),
        None => tree.tool(&base)?,
    };
    let path = tree.path(&base, &tool).ok_or_else(|| {
        format!("expected a tool below the base, found `{tool}` that is not below `{base}`")
    })?;
    let is_own = |joint: &&&Joint| joint.is_movable();
    let joints: Vec<String> = path.iter().filter(is_own).map(|joint| joint.name.clone()).collect();
    if joints.is_empty() {
        return Err(format!("nothing moves between `{base}` and `{tool}`"));
    }
    let why = if asked.tool.is_some() {
        asked.why
    } else if known.is_some() {
        "the tool that the model was learned for"
    } else {
        "found at the end of the longest chain; --tool names another"
    };
    notes.push(Note::found(format!("tool `{tool}`: {why}")));
    let base_link = (base != root).then(|| base.clone());
    let held_joints = tree.beside(&base, &joints);
    Ok(Arm { base_link, tool_link: tool, joints, held_joints })
}

struct Tree<'a> {
    document: &'a Document,
}

impl<'a> Tree<'a> {
    fn has(&self, link: &str) -> bool {
        self.document.links.iter().any(|other| other.name == link)
    }

    /// That no link has two parents: it would be gone through twice.
    fn check(&self) -> Result<(), String> {
        let mut above = BTreeMap::new();
        for Joint { name, child, .. } in &self.document.joints {
            if let Some(other) = above.insert(child, name) {
                return Err(format!(
                    "link `{child}` is the child of two joints, `{other}` and `{name}`: a URDF is a tree"
                ));
            }
        }
        Ok(())
    }

    fn parent(&self, link: &str) -> Option<&'a Joint> {
        self.document.joints.iter().find(|joint| joint.child == link)
    }

    fn children(&self, link: &str) -> Vec<&'a Joint> {
        self.document.joints.iter().filter(|joint| joint.parent == link).collect()
    }

    fn root(&self) -> Option<&'a str> {
        let mut roots = self.document.links.iter().filter(|link| self.parent(&link.name).is_none());
        let first = roots.next()?;
        roots.next().is_none().then_some(first.name.as_str())
    }

    /// The first link below a joint that no chain has: one that floats.
    fn below_floating(&self, root: &str) -> String {
        let floats =
            |joint: &&Joint| matches!(joint.joint_type, JointType::Floating | JointType::Planar);
        let mut at = root.to_owned();
        // A tree is no deeper than it has links.
        for _ in 0..self.document.links.len() {
            let children = self.children(&at);
            match children.iter().find(|joint| floats(joint)) {
                Some(joint) => return joint.child.clone(),
                None => match children[..] {
                    [joint] if !joint.is_movable() => at.clone_from(&joint.child),
                    _ => break,
                },
            }
        }
        root.to_owned()
    }

    /// The joints from the base to a link; `None` when it is not below.
    fn path(&self, base: &str, link: &str) -> Option<Vec<&'a Joint>> {
        let (mut path, mut at) = (Vec::new(), link);
        while at != base {
            let joint = self.parent(at)?;
            if path.len() > self.document.joints.len() {
                return None;
            }
            path.push(joint);
            at = &joint.parent;
        }
        path.reverse();
        Some(path)
    }

    /// How many joints move one after the other below a link, at most, and the link at which that ends.
    fn depth(&self, link: &str, bound: usize) -> usize {
        if bound == 0 {
            return 0;
        }
        let below =
            |joint: &&Joint| usize::from(joint.is_movable()) + self.depth(&joint.child, bound - 1);
        self.children(link).iter().map(below).max().unwrap_or(0)
    }

    /// Whether a joint is a gripper's: it mimics another, or is named so; or its link is and nothing moves on that.
    fn is_gripper(&self, joint: &Joint) -> bool {
        let has = |name: &str| GRIPPER_WORDS.iter().any(|word| name.to_lowercase().contains(word));
        let carries_fingers = || self.depth(&joint.child, self.document.links.len()) > 0;
        let named = has(&joint.name) || (has(&joint.child) && !carries_fingers());
        joint.is_movable() && (named || joint.mimic.is_some())
    }

    /// The end of the arm below a base, and the tool there.
    fn tool(&self, base: &str) -> Result<String, String> {
        let bound = self.document.links.len();
        let (mut at, mut moved) = (base.to_owned(), false);
        for _ in 0..bound {
            let depth =
                |joint: &Joint| usize::from(joint.is_movable()) + self.depth(&joint.child, bound);
            let moving: Vec<&Joint> =
                self.children(&at).into_iter().filter(|joint| depth(joint) > 0).collect();
            let arms: Vec<&&Joint> =
                moving.iter().filter(|joint| depth(joint) > FINGER_JOINTS_MAX).collect();
            let next = match (&arms[..], &moving[..]) {
                ([arm], _) => **arm,
                ([], [only]) if !self.is_gripper(only) => *only,
                ([], _) => break,
                _ => {
                    let names: Vec<_> =
                        arms.iter().map(|joint| format!("`{}`", joint.name)).collect();
                    return Err(format!(
                        "expected one arm, found {} that begin at `{at}` with the joints {}: say which by --tool LINK",
                        arms.len(),
                        names.join(", ")
                    ));
                }
            };
            if self.is_gripper(next) && moved {
                break;
            }
            moved |= next.is_movable();
            at.clone_from(&next.child);
        }
        Ok(self.named_tool(&at))
    }

    /// A frame fixed to a link that is named like a tool, or the link.
    fn named_tool(&self, link: &str) -> String {
        let (mut fixed, mut open) = (Vec::new(), vec![link.to_owned()]);
        while let Some(at) = open.pop() {
            let children = self.children(&at).into_iter().filter(|joint| !joint.is_movable());
            open.extend(children.map(|joint| joint.child.clone()));
            fixed.push(at);
            if fixed.len() > self.document.links.len() {
                break;
            }
        }
        let has = |link: &String, word: &str| link.to_lowercase().contains(word);
        let is_finger = |link: &String| GRIPPER_WORDS.iter().any(|word| has(link, word));
        let named =
            |word: &&str| fixed.iter().skip(1).find(|link| has(link, word) && !is_finger(link));
        TOOL_WORDS.iter().find_map(named).cloned().unwrap_or_else(|| link.to_owned())
    }

    /// The joints below the base that move and are not the arm's: held at zero, or in the middle of their range
    /// where zero is outside.
    fn beside(&self, base: &str, own: &[String]) -> BTreeMap<String, f64> {
        let is_beside = |joint: &&Joint| {
            joint.is_movable()
                && joint.mimic.is_none()
                && !own.contains(&joint.name)
                && self.path(base, &joint.child).is_some()
        };
        let at = |joint: &Joint| match (joint.limit.lower, joint.limit.upper) {
            (Some(lower), Some(upper)) if !(lower..=upper).contains(&0.0) && lower < upper => {
                0.5 * (lower + upper)
            }
            _ => 0.0,
        };
        let beside = self.document.joints.iter().filter(is_beside);
        beside.map(|joint| (joint.name.clone(), at(joint))).collect()
    }
}
