//! What is allowed and yet looks wrong: numbers in other units, masses that are missing, axes that are swapped.

use std::fmt;

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;

use crate::document::{Document, Inertial, Joint, JointType, Link, Shape};
use crate::error::{UrdfError, UrdfErrorKind as Kind};
use crate::ranges::POSITION_LIMIT_MAX;
use crate::selection::{Interface, Selection};
use crate::tree::{Motion, Tree};
use crate::urdf::faults_of;

/// A joint that turns farther to one side is rare, and 180 is degrees [rad].
const ANGLE_PLAUSIBLE_RAD: f64 = 6.0 * std::f64::consts::PI;
/// A joint of an arm that turns as fast is rare, and 180 is degrees [rad/s].
const SPEED_PLAUSIBLE_RAD_S: f64 = 100.0;
/// A joint that slides farther is rare, and 500 is millimetres [m].
const TRAVEL_PLAUSIBLE_M: f64 = 20.0;
/// A joint of an arm that slides faster is rare, and 500 is millimetres [m/s].
const SPEED_PLAUSIBLE_M_S: f64 = 50.0;
/// From here on a velocity limit is no limit that anyone measured, in whatever unit.
const SPEED_PLACEHOLDER: f64 = 1e4;
/// Radii of gyration up to here are never remarked on [m].
const GYRATION_PLAUSIBLE_M: f64 = 1.0;
/// How far the largest principal moment may exceed the sum of the others: room for rounded figures.
const TRIANGLE_ROOM: f64 = 1e-3;
/// From this ratio of length to width on a shape has a direction.
const ELONGATED: f64 = 3.0;
/// So much larger than the others' mean is a moment that is clearly the largest.
const SWAPPED: f64 = 1.2;

/// Something that looks wrong. Its text says what, and what it could be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark {
    /// Line of the file, from 1, where it belongs to one.
    pub line: Option<usize>,
    /// What looks wrong.
    pub text: String,
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(line) = self.line {
            write!(f, "line {line}: ")?;
        }
        f.write_str(&self.text)
    }
}

/// What looks wrong in the selected chain of a document, although it can be used.
///
/// # Errors
///
/// [`UrdfError`] when there is no such chain.
pub fn remarks(document: &Document, selection: &Selection) -> Result<Vec<Remark>, UrdfError> {
    let of = |faults| UrdfError::of(&document.file, faults);
    let (tree, _) = Tree::new(document, selection).map_err(of)?;
    let mut remarks = Vec::new();
    let moving: Vec<_> =
        tree.path.iter().filter(|i| matches!(tree.motion(**i), Motion::Free(_))).collect();
    for &&index in &moving {
        let joint = &document.joints[index];
        let line = joint.limit.line.unwrap_or(joint.line);
        let given = selection.limits.get(&joint.name).copied().unwrap_or_default();
        let texts = [
            given.position.is_none().then(|| position(joint)).flatten(),
            given.velocity.is_none().then(|| velocity(joint)).flatten(),
        ];
        remarks.extend(texts.into_iter().flatten().map(|text| Remark { line: Some(line), text }));
    }
    let reach: f64 =
        tree.path.iter().map(|&i| DVec3::from(document.joints[i].origin.xyz).length()).sum();
    let first = moving.first().map(|index| document.joints[**index].child.as_str());
    let mut open: Vec<&str> = first.into_iter().collect();
    while let Some(name) = open.pop() {
        let (_, link) = tree.link(name);
        let texts = link_remarks(link, reach.max(GYRATION_PLAUSIBLE_M));
        remarks.extend(texts.into_iter().map(|text| Remark { line: Some(link.line), text }));
        open.extend(tree.children(name).rev().map(|(_, joint)| joint.child.as_str()));
    }
    if selection.interface == Interface::Motion {
        let by_torque = Selection { interface: Interface::Effort, ..selection.clone() };
        let massless = faults_of(document, &by_torque).into_iter();
        let massless = massless.filter(|fault| matches!(fault.kind, Kind::NoMass { .. }));
        remarks.extend(massless.map(|fault| Remark { line: None, text: fault.kind.to_string() }));
    }
    Ok(remarks)
}

fn position(joint: &Joint) -> Option<String> {
    if joint.joint_type == JointType::Continuous {
        return None;
    }
    let name = &joint.name;
    let ends = [joint.limit.lower?, joint.limit.upper?];
    if ends.iter().any(|end| end.abs() > POSITION_LIMIT_MAX) {
        return Some(format!("joint `{name}`: position limits {ends:?} are taken as none"));
    }
    let (plausible, like) = match joint.joint_type {
        JointType::Revolute => (ANGLE_PLAUSIBLE_RAD, "degrees, not rad"),
        JointType::Prismatic => (TRAVEL_PLAUSIBLE_M, "millimetres, not m"),
        _ => return None,
    };
    let is_far = ends.iter().any(|end| end.abs() > plausible);
    is_far.then(|| format!("joint `{name}`: position limits {ends:?} look like {like}"))
}

fn velocity(joint: &Joint) -> Option<String> {
    let velocity = joint.limit.velocity?;
    let is_prismatic = joint.joint_type == JointType::Prismatic;
    let like = match (is_prismatic, velocity) {
        (_, SPEED_PLACEHOLDER..) => "a placeholder, no limit",
        (true, velocity) if velocity > SPEED_PLAUSIBLE_M_S => "mm/s, not m/s",
        (false, SPEED_PLAUSIBLE_RAD_S..) => "degrees/s, not rad/s",
        _ => return None,
    };
    Some(format!("joint `{}`: a velocity limit of {velocity} looks like {like}", joint.name))
}

/// What looks wrong with the masses of a link of an arm that reaches so far [m].
fn link_remarks(link: &Link, reach: f64) -> Vec<String> {
    let name = &link.name;
    let Some(inertial) = &link.inertial else {
        let text =
            format!("link `{name}`: it has a body and no <inertial>, so it counts as massless");
        return link.has_body.then_some(text).into_iter().collect();
    };
    let mut moments: Vec<f64> =
        Matrix3::from(inertial.inertia).symmetric_eigenvalues().iter().copied().collect();
    moments.sort_by(f64::total_cmp);
    let [small, middle, large] = moments[..] else { return Vec::new() };
    let gyration = (large / inertial.mass).sqrt();
    let mut texts = Vec::new();
    if inertial.mass > 0.0 && gyration > reach {
        texts.push(format!(
            "link `{name}`: an inertia of {large} kg m² for {} kg is that of a mass {gyration:.3} m away, farther than \
             the arm reaches ({reach:.3} m); files in g mm² are too large by 10⁹",
            inertial.mass
        ));
    }
    if large > (small + middle) * (1.0 + TRIANGLE_ROOM) {
        texts.push(format!(
            "link `{name}`: no body has the principal moments {small}, {middle} and {large} kg m²: the largest is at \
             most the sum of the others"
        ));
    }
    texts.extend(swapped(link, inertial, large));
    texts
}

/// A long body has its smallest moment about its long axis: with the largest one there, axes are swapped.
fn swapped(link: &Link, inertial: &Inertial, large: f64) -> Option<String> {
    let [collision] = &link.collisions[..] else { return None };
    let axis = match collision.shape {
        Shape::Cylinder { radius, length } | Shape::Capsule { radius, length } => {
            (length > ELONGATED * 2.0 * radius).then_some(DVec3::Z)?
        }
        Shape::Box { size } => {
            let size = DVec3::from(size);
            let long = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().find(|axis| {
                let width = (size * (DVec3::ONE - *axis)).max_element();
                size.dot(*axis) > ELONGATED * width
            });
            long?
        }
        Shape::Sphere { .. } | Shape::Mesh { .. } => return None,
    };
    let axis = inertial.origin.placement().rotation.transpose()
        * (collision.origin.placement().rotation * axis);
    let about = axis.dot(DMat3::from_cols_array_2d(&inertial.inertia) * axis);
    // Of a rod it is almost zero there.
    let trace: f64 = (0..3).map(|i| inertial.inertia[i][i]).sum();
    (about > 0.9 * large && about > SWAPPED * (trace - about) / 2.0).then(|| {
        format!(
            "link `{}`: about the long axis of its collision shape it has its largest moment, {about} kg m², where a \
             long body has its smallest: axes look swapped",
            link.name
        )
    })
}
