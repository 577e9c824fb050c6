//! Names of columns that are nearly a known one: another case, another unit, an underscore more or less.

/// What ends a name to say its unit; longer ones first.
const UNITS: [&str; 16] = [
    "mm_s", "rad_s", "m_s", "mm/s", "m/s", "sec", "rad", "deg", "mm", "cm", "ms", "us", "ns", "m",
    "s", "degrees",
];
/// What names of positions begin with elsewhere …
const POSITION: [&str; 4] = ["position", "translation", "pos", "trans"];
/// … and those of quaternions.
const QUATERNION: [&str; 5] = ["quaternion", "orientation", "rotation", "quat", "rot"];

/// A name without case, unit and separators.
pub(super) fn bare(name: &str) -> String {
    let name = name.trim().to_lowercase();
    // A unit in brackets.
    let name = name.split(['[', '(']).next().unwrap_or_default().trim_end();
    let without_unit = UNITS.iter().find_map(|unit| {
        let stem = name.strip_suffix(unit)?;
        let stem = stem.strip_suffix(['_', ' ', '.', '-'])?;
        (!stem.is_empty()).then_some(stem)
    });
    without_unit.unwrap_or(name).chars().filter(|c| c.is_alphanumeric()).collect()
}

/// Which of the known names a name is nearly, or spells in another manner.
pub(super) fn nearly<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    let bare_name = bare(name);
    let found = known.iter().find(|known| bare(known) == bare_name);
    if let Some(found) = found {
        return (*found != name).then_some(found);
    }
    let spelled = |beginnings: &[&str], before: &str| {
        let rest = beginnings.iter().find_map(|beginning| bare_name.strip_prefix(beginning))?;
        known.iter().find(|known| !rest.is_empty() && bare(known) == format!("{before}{rest}"))
    };
    spelled(&QUATERNION, "q").or_else(|| spelled(&POSITION, "")).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: [&str; 9] =
        ["time_s", "x_m", "y_m", "z_m", "qw", "qx", "vx_m_s", "elbow_joint", "gripper"];

    #[test]
    fn names_that_differ_by_case_unit_or_separator_are_found() {
        for (name, expected) in [
            ("QW", "qw"),
            ("q_w", "qw"),
            ("Qw", "qw"),
            ("quat_w", "qw"),
            ("orientation.x", "qx"),
            ("z", "z_m"),
            ("Z_m", "z_m"),
            ("z_mm", "z_m"),
            ("z [m]", "z_m"),
            ("pos_z", "z_m"),
            ("position.x", "x_m"),
            ("time", "time_s"),
            ("Time_s", "time_s"),
            ("time_ns", "time_s"),
            ("vx", "vx_m_s"),
            ("v_x_mm_s", "vx_m_s"),
            ("elbow_joint_deg", "elbow_joint"),
            ("ElbowJoint", "elbow_joint"),
        ] {
            assert_eq!(nearly(name, &KNOWN), Some(expected), "{name}");
        }
    }

    #[test]
    fn other_names_are_not() {
        for name in ["qw", "note", "", "_", "xyz", "force_z", "q", "frame_index", "pos", "m", "ä"]
        {
            assert_eq!(nearly(name, &KNOWN), None, "{name}");
        }
    }
}
