//! What a file is that is no URDF.

use crate::error::{UrdfErrorKind as Kind, UrdfFault};
use crate::xml::Element;

/// Refuses a text that is no XML, named for what it is.
///
/// # Errors
/// What was found and what to do.
pub(crate) fn check_text(text: &str) -> Result<(), UrdfFault> {
    let start = text.trim_start();
    let lower: String = start.chars().take(200).collect::<String>().to_lowercase();
    let is_page = lower.starts_with("<!doctype html") || lower.starts_with("<html");
    let (found, remedy) = if start.is_empty() {
        ("an empty file", "copy or export it again")
    } else if lower.starts_with("version https://git-lfs") {
        ("a pointer of Git LFS in place of the file", "fetch the file itself: `git lfs pull`")
    } else if is_page {
        ("a web page (HTML)", "download the file itself, in its raw form")
    } else if lower.contains('\0') {
        ("a binary file", "name the .urdf file")
    } else if start.starts_with('<') {
        return Ok(());
    } else if lower.contains("404") || lower.contains("not found") {
        ("the message of a download that failed", "download it again from the right address")
    } else if start.starts_with(['{', '[']) {
        ("JSON", "name the .urdf file")
    } else {
        let first: String = start.lines().next().unwrap_or("").chars().take(40).collect();
        let found = format!("no XML, it begins with `{first}`");
        return Err(UrdfFault::at(1, Kind::NotUrdf { found, remedy: "name the .urdf file" }));
    };
    Err(UrdfFault::new(Kind::NotUrdf { found: found.into(), remedy }))
}

/// Refuses a document whose root is not a robot with links, named for what it is.
///
/// # Errors
/// What was found and what to do.
pub(crate) fn check_root(root: &Element) -> Result<(), UrdfFault> {
    let is_srdf = |child: &Element| ["group", "disable_collisions"].contains(&child.name.as_str());
    let (found, remedy) = match root.name.to_lowercase().as_str() {
        "robot" if root.child("link").is_some() => return Ok(()),
        "robot" if root.children.iter().any(is_srdf) => {
            ("an SRDF".into(), "name the .urdf file that it belongs to")
        }
        "robot" => (
            "a robot without any <link>".into(),
            "name the file of the whole robot: one of macros alone describes none",
        ),
        "html" => ("a web page (HTML)".into(), "download the file itself, in its raw form"),
        "sdf" | "world" | "model" => {
            ("an SDF of Gazebo".into(), "use the URDF that the robot's maker offers, or convert it")
        }
        "mujoco" | "mujocoinclude" => {
            ("an MJCF of MuJoCo".into(), "use the URDF that the robot's maker offers")
        }
        "collada" => ("a COLLADA mesh".into(), "name the .urdf file that refers to it"),
        "launch" => ("a launch file of ROS".into(), "name the .urdf or .xacro file that it loads"),
        "package" => ("a package manifest of ROS".into(), "name the .urdf file of that package"),
        _ => (format!("the root element <{}>", root.name), "a URDF has the root element <robot>"),
    };
    Err(UrdfFault::at(root.line, Kind::NotUrdf { found, remedy }))
}
