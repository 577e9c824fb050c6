//! A header for C and C++.

use std::fmt::Write as _;

use tprmp_messages::{
    CONSTANTS, ENUMS, EnumLayout, FieldLayout, ICEORYX2_VERSION, MESSAGES, MessageLayout, PREFIX,
    ROOT, SERVICES, Scalar,
};

use super::{plain, snake, wrapped};

const WIDTH: usize = 100;

const HEAD: &str = "\
/* The messages of tprmp. Made by `controller layout --format c`: do not edit.
 *
 * SI units, quaternions w x y z, poses and velocities in the robot's base frame, times in ns on
 * CLOCK_MONOTONIC. Names are UTF-8, padded with zeros. */
#ifndef TPRMP_MESSAGES_H
#define TPRMP_MESSAGES_H

#include <assert.h>
#include <stddef.h>
#include <stdint.h>

/* Versions of iceoryx2 do not talk to each other. */
";

/// A comment over what it is about.
fn comment(text: &mut String, doc: &[&str], indent: &str) {
    let lines = wrapped(&plain(doc), &format!("{indent} * "), WIDTH - 3);
    let first = lines[0].replacen(" * ", "/* ", 1);
    let rest = lines[1..].iter().fold(String::new(), |all, line| format!("{all}\n{line}"));
    let _ = writeln!(text, "{first}{rest} */");
}

fn message(text: &mut String, message: &MessageLayout) {
    let name = format!("tprmp_{}", snake(message.name));
    text.push('\n');
    comment(text, message.doc, "");
    let _ = writeln!(text, "typedef struct {name} {{");
    for field in message.fields {
        comment(text, field.doc, "    ");
        let kind = match field.scalar {
            Scalar::U8 => "uint8_t".into(),
            Scalar::U32 => "uint32_t".into(),
            Scalar::U64 => "uint64_t".into(),
            Scalar::F64 => "double".into(),
            Scalar::Message(name) => format!("tprmp_{}", snake(name)),
        };
        let count = field.count.map_or(String::new(), |count| format!("[{count}]"));
        let _ = writeln!(text, "    {kind} {}{count};", field.field);
    }
    let _ = writeln!(text, "}} {name};");
    let _ = writeln!(text, "#define {}_TYPE_NAME \"{}\"", name.to_uppercase(), message.type_name);
    let _ = writeln!(text, "static_assert(sizeof({name}) == {}, \"{name}\");", message.size);
    for FieldLayout { field, offset, .. } in message.fields {
        let _ =
            writeln!(text, "static_assert(offsetof({name}, {field}) == {offset}, \"{field}\");");
    }
}

fn listed(text: &mut String, listed: &EnumLayout) {
    let name = format!("tprmp_{}", snake(listed.name));
    text.push('\n');
    comment(text, listed.doc, "");
    let _ = writeln!(text, "typedef enum {name} {{");
    for value in listed.values {
        comment(text, value.doc, "    ");
        let own = snake(value.name).to_uppercase();
        let _ = writeln!(text, "    {}_{own} = {},", name.to_uppercase(), value.value);
    }
    let _ = writeln!(text, "}} {name};");
}

pub(super) fn layout() -> String {
    let mut text = HEAD.to_owned();
    let _ = writeln!(text, "#define TPRMP_ICEORYX2_VERSION \"{ICEORYX2_VERSION}\"");
    let _ = writeln!(text, "/* Names of an instance's files in /dev/shm begin so. */");
    let _ = writeln!(text, "#define TPRMP_PREFIX \"{PREFIX}\"");
    let _ = writeln!(text, "#define TPRMP_ROOT \"{ROOT}\"\n");
    for (name, value) in CONSTANTS {
        let _ = writeln!(text, "#define TPRMP_{name} {value}");
    }
    for service in SERVICES {
        let (name, bounds) = (service.topic.to_uppercase(), service.bounds);
        let _ = writeln!(
            text,
            "\n/* Of {}, from {} to {}. */\n#define TPRMP_SERVICE_{name} \"<instance>/{}/v1\"",
            service.message.type_name, service.from, service.to, service.topic
        );
        for (bound, value) in [
            ("MAX_PUBLISHERS", bounds.publishers),
            ("MAX_SUBSCRIBERS", bounds.subscribers),
            ("MAX_NODES", bounds.nodes),
            ("HISTORY_SIZE", bounds.history),
            ("SUBSCRIBER_MAX_BUFFER_SIZE", bounds.buffer),
            ("ENABLE_SAFE_OVERFLOW", bounds.overflow.into()),
        ] {
            let _ = writeln!(text, "#define TPRMP_SERVICE_{name}_{bound} {value}");
        }
    }
    for of in ENUMS {
        listed(&mut text, of);
    }
    for of in MESSAGES {
        message(&mut text, of);
    }
    text + "\n#endif\n"
}
