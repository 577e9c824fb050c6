//! The configuration of what was chosen.

use tprmp_robot::LimitOverride;

use crate::init::text::{
    KEEP_UPRIGHT, LIMIT_ACTIVATION, SELF_ACTIVATION, Sections, Text, numbers, rounded, tuple,
};
use crate::init::{Chosen, Commands, Note, Plan, Task};
use crate::tool_axis::{APART_DEG, named, orientation, snapped};

/// The whole configuration, as text.
pub(super) fn configuration(plan: &mut Plan<'_>, chosen: &Chosen) -> String {
    let name = plan.options.urdf.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let heading = vec![
        format!(
            "Written by `controller init {}`; look at what it says is a default.",
            printable(&name)
        ),
        "SI units; the unit stands last in each key. Paths are relative to this file.".into(),
    ];
    let tool = tool_offset(plan, chosen);
    Sections {
        heading,
        robot: robot(plan, chosen, &tool),
        posture: posture(plan, chosen),
        collision: collision(plan, chosen),
        self_collision: self_collision(plan, chosen),
        replaced: vec![
            (SELF_ACTIVATION, self_activation(chosen)),
            (LIMIT_ACTIVATION, limit_activation(chosen)),
            (KEEP_UPRIGHT, keep_upright(plan, chosen)),
        ],
        task: match plan.options.task {
            Task::Pick => None,
            Task::Reach => Some(reach()),
        },
    }
    .configuration()
}

fn printable(text: &str) -> String {
    tprmp_files::printable(text).replace('\n', " ")
}

fn quoted(text: &str) -> String {
    format!("{text:?}")
}

/// The value of `robot.tool_offset`, with its reason.
fn tool_offset(plan: &mut Plan<'_>, chosen: &Chosen) -> (String, String) {
    let link = &plan.arm.tool_link;
    let none = |reason: String| (reason, "None".to_owned());
    if let (Some((frame, pose)), None) = (&plan.semantic.tool_frame, &plan.options.tool) {
        let frame = plan.model.map_or(frame, |model| &model.tool_frame);
        let q = pose.orientation;
        let value = format!(
            "Some((frame: {}, position_m: {}, quaternion_wxyz: {}))",
            quoted(frame),
            tuple(&pose.position.to_array()),
            tuple(&[q.w, q.x, q.y, q.z])
        );
        return ("The frame that the XRDF adds.".into(), value);
    }
    let Some(model) = plan.model else {
        return none(format!(
            "The tool is `{link}`, its approach axis {}.",
            named(chosen.tool_axis)
        ));
    };
    let Some(taught) = model.approach_axis().map(snapped) else {
        if model.tool_frame == *link {
            return none("The model was learned for this link.".into());
        }
        let value = format!(
            "Some((frame: {}, position_m: (0.0, 0.0, 0.0), quaternion_wxyz: (1.0, 0.0, 0.0, 0.0)))",
            quoted(&model.tool_frame)
        );
        return (format!("The model's tool, at `{link}`."), value);
    };
    let angle = taught.angle_between(chosen.tool_axis).to_degrees();
    if model.tool_frame == *link {
        if angle > APART_DEG {
            plan.notes.push(Note::lack(format!(
                "the model's tool comes to its goal along its {}, the arm's `{link}` points along its {}: {angle:.0}° \
                 apart; `robot.tool_offset` turns it",
                named(taught),
                named(chosen.tool_axis)
            )));
        }
        return none("The model was learned for this link.".into());
    }
    let q = orientation(chosen.tool_axis, taught);
    plan.notes.push(Note::lack(format!(
        "the model's tool `{}` is put at `{link}`, its {} along the arm's {}: set the position of its tip in \
         `robot.tool_offset`",
        model.tool_frame,
        named(taught),
        named(chosen.tool_axis)
    )));
    let value = format!(
        "Some((frame: {}, position_m: (0.0, 0.0, 0.0), quaternion_wxyz: {}))",
        quoted(&model.tool_frame),
        tuple(&[q.w, q.x, q.y, q.z])
    );
    let reason = format!(
        "The model's tool comes to its goal along its {}; the arm's `{link}` points along its {}. Where its tip is \
         beyond that link is not known: at its origin.",
        named(taught),
        named(chosen.tool_axis)
    );
    (reason, value)
}

fn limits(plan: &Plan<'_>, text: &mut Text) {
    let limits: Vec<_> =
        plan.selection.limits.iter().map(|(name, limit)| limit_text(name, limit)).collect();
    text.comment(if limits.is_empty() {
        "The URDF has them all; others count before them: {\"joint\": (position: None, velocity: Some(3.0), effort: None)}."
    } else {
        "Defaults: the URDF does not have them. See the data sheet."
    });
    text.list("limits", ["{", "}"], &limits);
}

fn robot(
    plan: &Plan<'_>,
    chosen: &Chosen,
    (tool_reason, tool_offset): &(String, String),
) -> String {
    let arm = &plan.arm;
    let mut text = Text::new(2);
    let urdf = relative(&plan.options.out, &plan.options.urdf);
    text.key("urdf", &quoted(&urdf));
    match &arm.base_link {
        None => text.comment("The root of the URDF."),
        Some(_) => text.comment("Asked for, or below a joint that floats."),
    };
    text.key(
        "base_link",
        &arm.base_link.as_ref().map_or("None".into(), |base| format!("Some({})", quoted(base))),
    );
    text.comment("The link that the skill moves.").key("tool_link", &quoted(&arm.tool_link));
    text.comment(tool_reason).key("tool_offset", tool_offset);
    text.comment(
        "A default: nothing beside the URDF's links. Else mass and centre in the tool's frame: Some((mass_kg: 0.5, \
         centre_m: (0.0, 0.0, 0.1))).",
    );
    text.key("payload", "None");
    let held: Vec<_> =
        arm.held_joints.iter().map(|(name, at)| format!("{}: {at:?}", quoted(name))).collect();
    text.comment(
        "Joints beside the arm: at zero, or in the middle of a range without it [rad or m].",
    );
    text.list("held_joints", ["{", "}"], &held);
    limits(plan, &mut text);
    text.comment("Links with collision shapes that need no control points.")
        .key("not_kept_clear", "[]");
    let points: Vec<_> = chosen.control_points.iter().map(point_text).collect();
    let spheres = chosen
        .cover
        .as_ref()
        .map_or("Of the XRDF.".to_owned(), |cover| format!("{}.", cover.summary()));
    text.comment(&spheres).list("control_points", ["Some([", "])"], &points);
    let joints: Vec<_> = arm.joints.iter().map(|name| quoted(name)).collect();
    text.comment("From the base to the tool.").key("joints", &format!("[{}]", joints.join(", ")));
    text.comment(if plan.mount.is_turned() {
        "In the base, which the joints above it turn; the root's z axis points up."
    } else {
        "A default: the root's z axis points up."
    });
    text.key("gravity_m_s2", &tuple(&plan.mount.gravity_m_s2()));
    actuators(plan, chosen, &mut text);
    text.comment(&format!("{}.", capital(&chosen.rates.acceleration_reason)));
    text.key("acceleration_max", &numbers(&chosen.rates.acceleration));
    text.comment(&format!("{}.", capital(&chosen.rates.jerk_reason)));
    text.key("jerk_max", &numbers(&chosen.rates.jerk));
    text.comment(if chosen.known.dynamics {
        "A default: the full torque within 5 ms."
    } else {
        "A default: the full torque within 5 ms, of 100 N m where the URDF has no limit."
    });
    text.key("effort_rate_max", &numbers(&chosen.rates.effort_rate));
    text.comment("Defaults: of the URDF's limits so much may be used, the rest is reserve.");
    text.key("velocity_fraction", "0.9").key("effort_fraction", "0.95");
    text.comment("A default: kept from the position limits, a fiftieth of the smallest range at most [rad or m].");
    text.key("position_margin", &format!("{:?}", chosen.position_margin));
    working_range(plan, chosen, &mut text);
    text.comment("Defaults, of the tool and of the joints' origins: `controller ctl set` lowers the speed in motion.");
    text.key(
        "point_limits",
        "Some((speed_max_m_s: 1.5, acceleration_max_m_s2: 30.0, power_max_w: 400.0))",
    );
    text.finish()
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

fn limit_text(name: &str, limit: &LimitOverride) -> String {
    let position = limit.position.map_or("None".into(), |[a, b]| format!("Some(({a:?}, {b:?}))"));
    let number =
        |value: Option<f64>| value.map_or("None".into(), |value| format!("Some({value:?})"));
    format!(
        "{}: (position: {position}, velocity: {}, effort: {})",
        quoted(name),
        number(limit.velocity),
        number(limit.effort)
    )
}

fn point_text((link, centre, radius): &(String, glam::DVec3, f64)) -> String {
    let at = tuple(&centre.to_array().map(|number| (number * 1e4).round() / 1e4));
    format!("(link: {}, position_m: {at}, radius_m: {radius:.4})", quoted(link))
}

fn actuators(plan: &Plan<'_>, chosen: &Chosen, text: &mut Text) {
    let servo = "((lag_s: 0.02, reference_time_constant_s: 0.5))";
    let lag = "A default: `lag_s` is how far the arm lags behind its command; measure it [s].";
    match plan.options.commands {
        Commands::Position => text.comment(lag).key("actuators", &format!("PositionServo{servo}")),
        Commands::Velocity => text.comment(lag).key("actuators", &format!("VelocityServo{servo}")),
        Commands::Torque => {
            let of = |joint: &String| {
                let found = plan.document.joints.iter().find(|other| other.name == *joint);
                found.and_then(|joint| joint.dynamics)
            };
            let all = |get: fn(tprmp_robot::document::Dynamics) -> f64| {
                numbers(
                    &plan
                        .arm
                        .joints
                        .iter()
                        .map(|joint| of(joint).map_or(0.0, get))
                        .collect::<Vec<_>>(),
                )
            };
            text.comment("Friction from the URDF's <dynamics>, none where it has none; it does not have rotors. What is missing is found, too much makes the arm swing.");
            let lines = [
                format!("rotor_inertia: {}", numbers(&vec![0.0; chosen.home.len()])),
                format!("coulomb_friction: {}", all(|dynamics| dynamics.friction.max(0.0))),
                format!("viscous_friction: {}", all(|dynamics| dynamics.damping.max(0.0))),
                "friction_speed: 0.001".to_owned(),
            ];
            text.list("actuators", ["Torque((", "))"], &lines)
        }
    };
}

fn working_range(plan: &Plan<'_>, chosen: &Chosen, text: &mut Text) {
    let bounded = plan.arm.joints.iter().zip(&chosen.working_range);
    let ranges: Vec<_> = bounded
        .filter_map(|(name, range)| range.map(|[a, b]| format!("{}: ({a:?}, {b:?})", quoted(name))))
        .collect();
    text.comment("Around the posture below: where the arm comes near a singular configuration, a joint has turned by half a turn, or links would meet that are not watched [rad].");
    text.list("working_range", ["{", "}"], &ranges);
}

fn posture(plan: &Plan<'_>, chosen: &Chosen) -> String {
    let mut text = Text::new(1);
    let home = numbers(&chosen.home);
    let reason = &chosen.home_reason;
    let decided = plan.model.map_or(6, |model| model.manifold.moved().len());
    if chosen.home.len() <= decided {
        text.comment(&format!(
            "The pose of the tool decides about all joints. A posture to begin from, {reason}: {home}."
        ));
        text.key("posture", "None");
        return text.finish();
    }
    text.comment(&format!(
        "The tool leaves {} of {} joints free: {reason}. Small against the skill, which it would hold off its goal.",
        chosen.home.len() - decided,
        chosen.home.len()
    ));
    let lines = [
        format!("position: {home}"),
        "inertia: 0.001".into(),
        "stiffness_1_s2: 4.0".into(),
        "damping_1_s: 4.0".into(),
        "saturation: 0.5".into(),
    ];
    text.list("posture", ["Some((", "))"], &lines);
    text.finish()
}

fn collision(plan: &Plan<'_>, chosen: &Chosen) -> String {
    let mut lines = Vec::new();
    for grounded in &chosen.grounded {
        let extent = grounded.near_axis_m.map_or("Whole".into(), |m| format!("NearAxis({m:.3})"));
        lines.push(format!(
            "(link: {}, obstacle: HalfSpace, extent: {extent})",
            quoted(&grounded.link)
        ));
    }
    let has_points = |link: &&String| chosen.control_points.iter().any(|(of, _, _)| of == *link);
    if plan.options.task == Task::Pick || plan.model.is_some() {
        for link in chosen.on_tool.iter().filter(has_points) {
            if !chosen.grounded.iter().any(|grounded| grounded.link == *link) {
                lines.push(format!(
                    "(link: {}, obstacle: HalfSpace, extent: Above(0.015))",
                    quoted(link)
                ));
            }
        }
    }
    let mut text = Text::new(2);
    text.comment("What is low in all of 400 postures stands on the ground; the tool reaches down to what lies there.");
    text.list("exempt", ["[", "]"], &lines);
    text.finish()
}

fn self_collision(plan: &Plan<'_>, chosen: &Chosen) -> String {
    let pair = |a: &str, b: &str, why: &str| format!("/* {why} */ ({}, {})", quoted(a), quoted(b));
    let harmless = chosen.harmless.iter();
    let mut lines: Vec<_> =
        harmless.map(|found| pair(&found.links[0], &found.links[1], &found.reason)).collect();
    let has_points = |link: &str| chosen.control_points.iter().any(|(of, ..)| of == link);
    let named = plan.semantic.ignored.iter().filter(|(a, b)| has_points(a) && has_points(b));
    lines.extend(named.map(|(a, b)| pair(a, b, "of the file")));
    let mut text = Text::new(2);
    text.comment(
        "Pairs that are near each other, by their spheres, in 20 or more of 400 postures within the working range, and whose shapes touch in none; and those that a file names.",
    );
    text.list("exempt", ["[", "]"], &lines);
    text.finish()
}

/// The activation distance between spheres of the arm: by as much less as they stick out.
fn self_activation(chosen: &Chosen) -> String {
    let distance = chosen.self_activation_m();
    format!(
        "// Less than 0.05 by as much as two spheres stick out, and 0.01 at least.\n            activation_distance_m: {distance:?},"
    )
}

/// What keeps the tool upright, where the arm could tilt it and the skill does not move that.
fn keep_upright(plan: &Plan<'_>, chosen: &Chosen) -> String {
    if !chosen.tilts_freely {
        return "keep_upright: None,".into();
    }
    let [tool, base] = [chosen.tool_axis, -plan.mount.up].map(|axis| tuple(&axis.to_array()));
    format!(
        "// Here the tool's approach axis points down: the skill leaves the tilt alone, which the arm can change.\n    \
         keep_upright: Some((tool_axis: {tool}, base_axis: {base}, angular_inertia_kg_m2: 0.5, stiffness_1_s2: 30.0, \
         damping_1_s: 10.0)),"
    )
}

/// The distance from a joint's limits at which they act: a quarter of the smallest range at most.
fn limit_activation(chosen: &Chosen) -> String {
    let distance = rounded(0.25 * chosen.smallest_range.min(0.8));
    format!(
        "// A quarter of the smallest range, 0.2 at most.\n        activation_distance: {distance:?},"
    )
}

fn reach() -> String {
    let mut text = Text::new(1);
    text.comment("The goal may be approached from any side.").key("approach", "None");
    text.comment("No gripper: the skill itself is the task.").key("lift", "None");
    text.comment("A default: so near the skill has done what it was learned for.");
    text.key("done", "(distance_m: 0.002, angle_rad: 0.02)");
    text.finish()
}

/// The path of a file as seen from a folder, where both have a folder in common; else the whole path.
fn relative(folder: &std::path::Path, file: &std::path::Path) -> String {
    let whole =
        |path: &std::path::Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let (folder, file) = (whole(folder), whole(file));
    let file = file.canonicalize().unwrap_or(file);
    let folder = folder.canonicalize().unwrap_or(folder);
    let parts = |path: &std::path::Path| {
        path.components().map(|part| part.as_os_str().to_owned()).collect::<Vec<_>>()
    };
    let (from, to) = (parts(&folder), parts(&file));
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    // The root alone is nothing in common.
    if common < 2 {
        return file.to_string_lossy().into_owned();
    }
    let up = std::iter::repeat_n("..".into(), from.len() - common);
    let path: std::path::PathBuf = up.chain(to[common..].iter().cloned()).collect();
    path.to_string_lossy().into_owned()
}
