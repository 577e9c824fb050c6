//! For people.

use std::fmt::Write as _;

use tprmp_messages::{
    CONSTANTS, ENUMS, FieldLayout, ICEORYX2_VERSION, MESSAGES, PREFIX, ROOT, SERVICES,
};

use super::plain;

fn kind(field: &FieldLayout) -> String {
    let scalar = field.scalar.name();
    field.count.map_or(scalar.to_owned(), |count| format!("{scalar}[{count}]"))
}

pub(super) fn layout() -> String {
    let mut text = format!(
        "iceoryx2 {ICEORYX2_VERSION}, exactly\nprefix {PREFIX}* in /dev/shm\nroot {ROOT}\n"
    );
    for (name, value) in CONSTANTS {
        let _ = writeln!(text, "{name} {value}");
    }
    text += "\nservices\n";
    for service in SERVICES {
        let _ = writeln!(
            text,
            "  <instance>/{}/v1  {}, {} → {}; {}",
            service.topic, service.message.type_name, service.from, service.to, service.bounds
        );
    }
    text += "  <instance>/control/v1  requests: ControlRequestV1, answers: ControlAnswerV1; max_servers 1, \
             max_clients 8, max_nodes 16\n";
    for message in MESSAGES {
        let _ = writeln!(
            text,
            "\n{}: {} on the wire, {} bytes. {}",
            message.name,
            message.type_name,
            message.size,
            plain(message.doc)
        );
        let _ = writeln!(
            text,
            "  {:>6} {:>5}  {:<13} {:<18} meaning",
            "offset", "bytes", "type", "field"
        );
        for field in message.fields {
            let (kind, doc) = (kind(field), plain(field.doc));
            let FieldLayout { offset, size, field, .. } = field;
            let _ = writeln!(text, "  {offset:>6} {size:>5}  {kind:<13} {field:<18} {doc}");
        }
    }
    for listed in ENUMS {
        let _ = writeln!(text, "\n{}: {}", listed.name, plain(listed.doc));
        for value in listed.values {
            let _ = writeln!(text, "  {:>3}  {:<22} {}", value.value, value.name, plain(value.doc));
        }
    }
    text
}
