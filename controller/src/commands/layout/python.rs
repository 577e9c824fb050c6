//! A module of ctypes.

use std::fmt::Write as _;

use tprmp_messages::{
    CONSTANTS, ENUMS, FieldLayout, ICEORYX2_VERSION, MESSAGES, MessageLayout, PREFIX, ROOT,
    SERVICES, Scalar,
};

use super::{plain, snake, wrapped};

const WIDTH: usize = 100;

const HEAD: &str = r#""""The messages of tprmp, as ctypes. Made by `controller layout --format python`: do not edit.

SI units, quaternions w x y z, poses and velocities in the robot's base frame, times in ns on
CLOCK_MONOTONIC. Names are UTF-8, padded with zeros.
"""

import ctypes
from enum import IntEnum
"#;

fn docstring(text: &mut String, doc: &[&str]) {
    let plain = plain(doc);
    let (first, rest) = plain.split_once(". ").unwrap_or((&plain, ""));
    let first = wrapped(&format!("\"\"\"{}.", first.trim_end_matches('.')), "    ", WIDTH - 3);
    let _ = write!(text, "{}", first.join("\n"));
    if rest.is_empty() {
        text.push_str("\"\"\"\n");
    } else {
        let _ = writeln!(text, "\n\n{}\n    \"\"\"", wrapped(rest, "    ", WIDTH).join("\n"));
    }
}

/// A line of code with what it means: behind it where that fits, else above it.
fn line(text: &mut String, indent: &str, code: &str, doc: &[&str]) {
    let doc = plain(doc);
    let one = format!("{indent}{code}  # {doc}");
    let lines = if one.chars().count() <= WIDTH {
        one
    } else {
        format!("{}\n{indent}{code}", wrapped(&doc, &format!("{indent}# "), WIDTH).join("\n"))
    };
    let _ = writeln!(text, "{lines}");
}

fn message(text: &mut String, message: &MessageLayout) {
    let _ = writeln!(text, "\n\nclass {}(ctypes.Structure):", message.name);
    docstring(text, message.doc);
    text.push_str("\n    _fields_ = [\n");
    for FieldLayout { field, scalar, count, doc, .. } in message.fields {
        let kind = match scalar {
            Scalar::U8 => "ctypes.c_uint8",
            Scalar::U32 => "ctypes.c_uint32",
            Scalar::U64 => "ctypes.c_uint64",
            Scalar::F64 => "ctypes.c_double",
            Scalar::Message(name) => name,
        };
        let count = count.map_or(String::new(), |count| format!(" * {count}"));
        line(text, "        ", &format!("(\"{field}\", {kind}{count}),"), doc);
    }
    let MessageLayout { name, type_name, size, .. } = message;
    let _ = write!(
        text,
        "    ]\n\n    @staticmethod\n    def type_name() -> str:\n        \
         \"\"\"Name on the wire.\"\"\"\n        return \"{type_name}\"\n\n\n\
         assert ctypes.sizeof({name}) == {size}\n"
    );
    for FieldLayout { field, offset, .. } in message.fields {
        let _ = writeln!(text, "assert {name}.{field}.offset == {offset}");
    }
}

pub(super) fn layout() -> String {
    let mut text = format!("{HEAD}\nICEORYX2_VERSION = \"{ICEORYX2_VERSION}\"\n");
    let _ = writeln!(text, "PREFIX = \"{PREFIX}\"\nROOT = \"{ROOT}\"\n");
    for (name, value) in CONSTANTS {
        let _ = writeln!(text, "{name} = {value}");
    }
    text += "\nSERVICES = {\n";
    for service in SERVICES {
        let bounds = service.bounds;
        let _ = writeln!(text, "    \"{}\": {{", service.topic);
        let _ = writeln!(text, "        \"name\": \"<instance>/{}/v1\",", service.topic);
        for (bound, value) in [
            ("max_publishers", bounds.publishers),
            ("max_subscribers", bounds.subscribers),
            ("max_nodes", bounds.nodes),
            ("history_size", bounds.history),
            ("subscriber_max_buffer_size", bounds.buffer),
        ] {
            let _ = writeln!(text, "        \"{bound}\": {value},");
        }
        let overflow = if bounds.overflow { "True" } else { "False" };
        let _ = writeln!(text, "        \"has_safe_overflow\": {overflow},\n    }},");
    }
    text += "}\n";
    for of in ENUMS {
        let _ = writeln!(text, "\n\nclass {}(IntEnum):", of.name);
        docstring(&mut text, of.doc);
        text.push('\n');
        for value in of.values {
            let code = format!("{} = {}", snake(value.name).to_uppercase(), value.value);
            line(&mut text, "    ", &code, value.doc);
        }
    }
    for of in MESSAGES {
        message(&mut text, of);
    }
    text
}
