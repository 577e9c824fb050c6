//! For programs.

use serde_json::{Value, json};
use tprmp_messages::{
    CONSTANTS, ENUMS, FieldLayout, ICEORYX2_VERSION, MESSAGES, MessageLayout, PREFIX, ROOT,
    SERVICES, ServiceLayout,
};

use super::plain;

fn field(field: &FieldLayout) -> Value {
    let scalar = field.scalar.name();
    json!({
        "field": field.field, "offset": field.offset, "size": field.size, "type": scalar,
        "count": field.count, "meaning": plain(field.doc),
    })
}

fn message(message: &MessageLayout) -> Value {
    json!({
        "message": message.name, "type_name": message.type_name, "size": message.size,
        "meaning": plain(message.doc), "fields": message.fields.iter().map(field).collect::<Value>(),
    })
}

fn service(service: &ServiceLayout) -> Value {
    let bounds = service.bounds;
    json!({
        "service": format!("<instance>/{}/v1", service.topic), "message": service.message.name,
        "from": service.from, "to": service.to,
        "bounds": {
            "max_publishers": bounds.publishers, "max_subscribers": bounds.subscribers,
            "max_nodes": bounds.nodes, "history_size": bounds.history,
            "subscriber_max_buffer_size": bounds.buffer, "enable_safe_overflow": bounds.overflow,
        },
    })
}

pub(super) fn layout() -> String {
    let constants: serde_json::Map<_, _> =
        CONSTANTS.iter().map(|(name, value)| ((*name).to_owned(), json!(value))).collect();
    let enums = ENUMS.iter().map(|listed| {
        let values = listed.values.iter().map(
            |value| json!({"name": value.name, "value": value.value, "meaning": plain(value.doc)}),
        );
        json!({
            "enum": listed.name, "meaning": plain(listed.doc), "values": values.collect::<Value>(),
        })
    });
    let all = json!({
        "iceoryx2": ICEORYX2_VERSION, "prefix": PREFIX, "root": ROOT, "constants": constants,
        "services": SERVICES.iter().map(service).collect::<Value>(),
        "requests": {
            "service": "<instance>/control/v1", "request": "ControlRequest",
            "answer": "ControlAnswer",
            "bounds": {"max_servers": 1, "max_clients": 8, "max_nodes": 16},
        },
        "messages": MESSAGES.iter().map(message).collect::<Value>(),
        "enums": enums.collect::<Value>(),
    });
    format!("{all:#}")
}
