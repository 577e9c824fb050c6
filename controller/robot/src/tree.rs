//! The links and joints of a document, checked to be a tree.

use std::collections::{BTreeMap, HashMap};

use crate::description::JointKind;
use crate::document::{Document, DocumentFault, Joint, JointType, Link, Owner};
use crate::error::{UrdfErrorKind as Kind, UrdfFault};
use crate::selection::Selection;

/// The links and joints of a file.
pub(crate) struct Tree<'a> {
    pub(crate) document: &'a Document,
    /// Indices into the document.
    links: HashMap<&'a str, usize>,
    /// Indices of the joints.
    joints: HashMap<&'a str, usize>,
    /// The parent joint of each link but the root.
    parents: HashMap<&'a str, usize>,
    /// The joints whose parent a link is, in the order of the file.
    children: HashMap<&'a str, Vec<usize>>,
    /// The base.
    pub(crate) root: &'a str,
    /// Joints from the base to the tool.
    pub(crate) path: Vec<usize>,
    held: &'a BTreeMap<String, f64>,
}

/// What becomes of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Motion {
    /// It is fixed, or held at a position [rad or m].
    Held(f64),
    /// It moves.
    Free(JointKind),
    /// It moves in a manner that is not supported.
    Unsupported,
    /// It follows a joint that moves, of this index if it is in the file.
    Follows(Option<usize>),
}

impl<'a> Tree<'a> {
    /// The tree with the faults that do not keep it from being one.
    ///
    /// # Errors
    /// All faults that are found before it can be said which links belong together.
    pub(crate) fn new(
        document: &'a Document,
        selection: &'a Selection,
    ) -> Result<(Self, Vec<UrdfFault>), Vec<UrdfFault>> {
        let mut tree = Self {
            document,
            links: HashMap::new(),
            joints: HashMap::new(),
            parents: HashMap::new(),
            children: HashMap::new(),
            root: "",
            path: Vec::new(),
            held: &selection.held_joints,
        };
        let is_structural = |part| ["name", "type", "parent", "child"].contains(&part);
        let structural = document.faults.iter().filter(|fault| is_structural(fault.part));
        let mut faults: Vec<_> = structural.map(|fault| fault.fault.clone()).collect();
        let unread = faults.len();
        tree.connect(&mut faults);
        if faults.len() > unread {
            return Err(faults);
        }
        tree.find_root(&mut faults);
        if faults.len() > unread {
            return Err(faults);
        }
        tree.select(selection, &mut faults);
        if faults.len() > unread { Err(faults) } else { Ok((tree, faults)) }
    }

    /// Finds links by their names and joints by the links that they connect.
    fn connect(&mut self, faults: &mut Vec<UrdfFault>) {
        let Document { links, joints, .. } = self.document;
        let twice = |element, name: &str, line, first| {
            let name = name.to_owned();
            UrdfFault::at(line, Kind::DuplicateName { element, name, first })
        };
        for (i, Link { name, line, .. }) in links.iter().enumerate() {
            if let Some(first) = self.links.insert(name, i) {
                faults.push(twice("link", name, *line, links[first].line));
            }
        }
        for (i, joint) in joints.iter().enumerate() {
            let (name, line) = (&joint.name, joint.line);
            if let Some(first) = self.joints.insert(name, i) {
                faults.push(twice("joint", name, line, joints[first].line));
            }
            for (role, link) in [("parent", &joint.parent), ("child", &joint.child)] {
                if !link.is_empty() && !self.links.contains_key(link.as_str()) {
                    let (joint, link) = (name.clone(), link.clone());
                    faults.push(UrdfFault::at(line, Kind::UnknownLink { joint, role, link }));
                }
            }
            if let Some(first) = self.parents.insert(&joint.child, i)
                && !joint.child.is_empty()
            {
                let (first, second) = (joints[first].name.clone(), name.clone());
                let link = joint.child.clone();
                faults.push(UrdfFault::at(line, Kind::TwoParents { link, first, second }));
            }
            self.children.entry(&joint.parent).or_default().push(i);
        }
    }

    fn find_root(&mut self, faults: &mut Vec<UrdfFault>) {
        let names = self.document.links.iter().map(|link| link.name.as_str());
        let roots: Vec<&str> =
            names.clone().filter(|name| !self.parents.contains_key(name)).collect();
        let [root] = roots[..] else {
            let found = roots.into_iter().map(str::to_owned).collect();
            return faults.push(UrdfFault::new(Kind::RootCount { found }));
        };
        self.root = root;
        // A tree is reached from its root, each link once; what is not lies on a loop.
        let (mut reached, mut open) = (0, vec![root]);
        while let Some(link) = open.pop() {
            reached += 1;
            open.extend(self.children(link).map(|(_, joint)| joint.child.as_str()));
        }
        if reached < self.links.len()
            && let Some(link) = names.clone().find(|name| self.path_to(name, root).is_none())
        {
            faults.push(UrdfFault::new(Kind::ClosedLoop { link: link.to_owned() }));
        }
    }

    /// Finds base and tool, and looks for the held joints.
    fn select(&mut self, selection: &'a Selection, faults: &mut Vec<UrdfFault>) {
        let links = || self.document.links.iter().map(|link| link.name.clone()).collect();
        let tool_link = &selection.tool_link;
        let has_tool = self.links.contains_key(tool_link.as_str());
        if !has_tool {
            let (tool_link, found) = (tool_link.clone(), links());
            faults.push(UrdfFault::new(Kind::UnknownToolLink { tool_link, found }));
        }
        for joint in self.held.keys().filter(|name| !self.joints.contains_key(name.as_str())) {
            let found = self.document.joints.iter().map(|joint| joint.name.clone()).collect();
            let joint = joint.clone();
            faults.push(UrdfFault::new(Kind::UnknownHeldJoint { joint, found }));
        }
        if let Some(base_link) = &selection.base_link {
            let Some(&base) = self.links.get(base_link.as_str()) else {
                let (base_link, found) = (base_link.clone(), links());
                return faults.push(UrdfFault::new(Kind::UnknownBaseLink { base_link, found }));
            };
            self.root = &self.document.links[base].name;
        }
        if !has_tool {
            return;
        }
        match self.path_to(tool_link, self.root) {
            Some(path) => self.path = path,
            None => {
                let (base_link, tool_link) = (self.root.to_owned(), tool_link.clone());
                faults.push(UrdfFault::new(Kind::NotAbove { base_link, tool_link }));
            }
        }
    }

    /// The joints from `base` to `link`, in that order; `None` where there is no such path.
    fn path_to(&self, link: &str, base: &str) -> Option<Vec<usize>> {
        let (mut path, mut link) = (Vec::new(), link);
        while link != base {
            let joint = *self.parents.get(link)?;
            // A path without a loop has fewer joints than the file has links.
            if path.len() >= self.links.len() {
                return None;
            }
            path.push(joint);
            link = &self.document.joints[joint].parent;
        }
        path.reverse();
        Some(path)
    }

    /// The link of this name, and its index.
    pub(crate) fn link(&self, name: &str) -> (usize, &'a Link) {
        let index = self.links[name];
        (index, &self.document.links[index])
    }

    /// The joints whose parent is `link`, with their indices.
    pub(crate) fn children(
        &self,
        link: &str,
    ) -> impl DoubleEndedIterator<Item = (usize, &'a Joint)> {
        let document = self.document;
        let children = self.children.get(link).map_or(&[][..], Vec::as_slice).to_vec();
        children.into_iter().map(move |i| (i, &document.joints[i]))
    }

    /// What becomes of a joint: one that follows a held joint is held too.
    pub(crate) fn motion(&self, joint: usize) -> Motion {
        // q = factor · (position of `joint`) + offset; a chain of followers is no longer than the file.
        let (asked, mut joint, mut factor, mut offset) = (joint, joint, 1.0, 0.0);
        for _ in 0..self.document.joints.len() {
            let found = &self.document.joints[joint];
            if let Some(position) = self.held.get(&found.name) {
                return Motion::Held(factor * position + offset);
            }
            match (&found.mimic, found.joint_type.clone()) {
                (_, JointType::Fixed) => return Motion::Held(offset),
                (Some(mimic), _) => match self.joints.get(mimic.joint.as_str()) {
                    Some(&master) => {
                        offset += factor * mimic.offset;
                        factor *= mimic.multiplier;
                        joint = master;
                    }
                    None => return Motion::Follows(None),
                },
                _ if joint != asked => return Motion::Follows(Some(joint)),
                (None, JointType::Revolute | JointType::Continuous) => {
                    return Motion::Free(JointKind::Revolute);
                }
                (None, JointType::Prismatic) => return Motion::Free(JointKind::Prismatic),
                (None, _) => return Motion::Unsupported,
            }
        }
        Motion::Follows(None)
    }

    /// Whether this part of a link or a joint could not be read.
    pub(crate) fn is_faulty(&self, owner: Owner, part: &str) -> bool {
        self.document.faults.iter().any(|fault| fault.owner == owner && fault.part == part)
    }

    /// Appends what could not be read of these parts of a link or a joint.
    pub(crate) fn faults_of(&self, owner: Owner, parts: &[&str], faults: &mut Vec<UrdfFault>) {
        let of = |fault: &&DocumentFault| fault.owner == owner && parts.contains(&fault.part);
        faults.extend(self.document.faults.iter().filter(of).map(|fault| fault.fault.clone()));
    }
}
