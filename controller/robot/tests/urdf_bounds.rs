//! Documents that are made to hurt are refused before they do: nothing recurses into them, and nothing
//! overflows.

use std::path::PathBuf;

use tprmp_robot::{Chain, count_joints};

/// The message for a document, which names the file.
fn refused(test: &str, text: impl AsRef<[u8]>) -> String {
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("bounds_{test}.urdf"));
    std::fs::write(&file, text).unwrap();
    let message = Chain::<2>::from_urdf(&file, "tool").unwrap_err().to_string();
    assert_eq!(count_joints(&file, "tool").unwrap_err().to_string(), message);
    assert!(message.starts_with(&format!("{}: ", file.display())), "file not named: {message}");
    message
}

/// Two joints, with these numbers in place of their own.
fn arm(mass: &str, origin: &str, velocity: &str) -> String {
    format!(
        r#"<robot name="arm"><link name="root"/>
        <link name="upper"><inertial><mass value="{mass}"/>
          <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
        <link name="tool"/>
        <joint name="first" type="revolute"><parent link="root"/><child link="upper"/>
          <origin xyz="0 0 {origin}"/><axis xyz="0 1 0"/>
          <limit lower="-1" upper="2" velocity="{velocity}" effort="4"/></joint>
        <joint name="second" type="revolute"><parent link="upper"/><child link="tool"/>
          <axis xyz="0 1 0"/><limit lower="-1" upper="2" velocity="3" effort="4"/></joint></robot>"#
    )
}

#[test]
fn nested_elements() {
    let deep = |tag: &str| format!("<robot name=\"r\">\n{}", format!("<{tag}>").repeat(40_000));
    for tag in ["a", "link name=\"l\"", "gazebo"] {
        let message = refused("deep", deep(tag));
        assert!(
            message.contains("line 2: expected a robot of at most 64 nested elements"),
            "{message}"
        );
    }
    let closed = format!("{}{}", "<a>".repeat(40_000), "</a>".repeat(40_000));
    assert!(refused("deep_closed", closed).contains("nested elements"));
}

#[test]
fn long_chains_and_wide_documents() {
    let chain: String = (0..10_000)
        .map(|i| {
            format!(
                "<link name=\"l{i}\"/>\n<joint name=\"j{i}\" type=\"fixed\"><parent link=\"l{i}\"/>\
                 <child link=\"l{}\"/></joint>\n",
                i + 1
            )
        })
        .collect();
    let message = refused("chain", format!("<robot name=\"r\">{chain}</robot>"));
    assert!(message.contains("line 2001: expected a robot of at most 1000 links"), "{message}");
    let wide = format!("<robot name=\"r\">{}</robot>", "<gazebo/>".repeat(60_000));
    assert!(refused("wide", wide).contains("at most 50000 elements"));
}

#[test]
fn text_that_is_not_utf_8_or_no_xml() {
    assert!(refused("utf8", b"<robot name=\"\xff\"/>").contains("UTF-8"));
    assert!(refused("zeros", [0; 4096]).contains("expected a URDF document"));
    assert!(refused("end", "<robot>\n</root>").contains("line 2"));
    let bomb = "<!DOCTYPE r [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;&a;\">]><robot name=\"&b;\"/>";
    assert!(refused("bomb", bomb).contains("expected a URDF document"));
}

#[test]
fn numbers_beyond_any_arm() {
    for (mass, origin, velocity, expected) in [
        ("1e308", "1", "3", "link `upper`: mass: expected at most 1e5 in SI units, found 1e308"),
        ("1", "1e200", "3", "joint `first`: origin xyz: expected at most 1e3"),
        ("1", "1", "1e308", "for `first` (line 7: velocity)"),
    ] {
        let message = refused("numbers", arm(mass, origin, velocity));
        assert!(message.contains(expected), "{message}");
    }
}
