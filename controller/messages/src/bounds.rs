//! The bounds of a service, compared wholly on both sides: iceoryx2 compares some of them, and only where they are
//! smaller than what is asked for, so that some deviations would work in one order of starting only.

use core::fmt;
use std::io::Read;
use std::path::PathBuf;

use iceoryx2::service::static_config::publish_subscribe::StaticConfig;

use crate::layout::MessageLayout;
use crate::messages::{ControllerStatus, JointCommand, RobotState, TaskFrames, ToolCommand};

/// The version of iceoryx2 that this program is built with.
pub const ICEORYX2_VERSION: &str = "0.9.3";
pub(crate) const VERSION: [u64; 3] = [0, 9, 3];

/// Most sources of frames of an instance, the state publisher's among them.
pub const FRAME_SOURCES_MAX: usize = 8;

/// Newest states that are kept for the controller, which judges each of them: as many as a publisher three
/// times as fast as the loop sends in five ticks.
pub const STATE_BUFFER: usize = 16;

/// Newest states and statuses that are kept for an observer, which wants each of them; the robot
/// gets the newest command only.
pub const OBSERVER_BUFFER: usize = 256;

/// Most readers that a service can have.
pub(crate) const SUBSCRIBERS_MAX: usize = 8;

/// The bounds of a service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServiceBounds {
    /// Most publishers.
    pub publishers: usize,
    /// Most subscribers.
    pub subscribers: usize,
    /// Most nodes.
    pub nodes: usize,
    /// Messages that a new subscriber gets.
    pub history: usize,
    /// Messages that are kept for a subscriber at most.
    pub buffer: usize,
    /// Whether the oldest message gives way to a new one.
    pub overflow: bool,
}

impl ServiceBounds {
    /// Those of a service with so many publishers and this buffer.
    const fn new(publishers: usize, buffer: usize) -> Self {
        let subscribers = SUBSCRIBERS_MAX;
        Self { publishers, subscribers, nodes: 16, history: 1, buffer, overflow: true }
    }

    /// Those that a service has.
    pub(crate) fn of(service: &StaticConfig) -> Self {
        Self {
            publishers: service.max_publishers(),
            subscribers: service.max_subscribers(),
            nodes: service.max_nodes(),
            history: service.history_size(),
            buffer: service.subscriber_max_buffer_size(),
            overflow: service.has_safe_overflow(),
        }
    }
}

impl fmt::Display for ServiceBounds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { publishers, subscribers, nodes, history, buffer, overflow } = self;
        write!(
            f,
            "max_publishers {publishers}, max_subscribers {subscribers}, max_nodes {nodes}, history_size \
             {history}, subscriber_max_buffer_size {buffer}, enable_safe_overflow {overflow}"
        )
    }
}

/// A publish-subscribe service of an instance.
#[derive(Debug, Clone, Copy)]
pub struct ServiceLayout {
    /// Its name is `<instance>/<topic>/v1`.
    pub topic: &'static str,
    /// What it carries.
    pub message: &'static MessageLayout,
    /// Who publishes.
    pub from: &'static str,
    /// Who reads.
    pub to: &'static str,
    /// What it is made with.
    pub bounds: ServiceBounds,
}

const fn service(
    topic: &'static str,
    message: &'static MessageLayout,
    [from, to]: [&'static str; 2],
    bounds: ServiceBounds,
) -> ServiceLayout {
    ServiceLayout { topic, message, from, to, bounds }
}

pub(crate) const ROBOT_STATE: &str = "robot_state";
pub(crate) const TASK_FRAMES: &str = "task_frames";
pub(crate) const JOINT_COMMAND: &str = "joint_command";
pub(crate) const CONTROLLER_STATUS: &str = "controller_status";
pub(crate) const TOOL_COMMAND: &str = "tool_command";

/// Every publish-subscribe service of an instance.
pub const SERVICES: &[ServiceLayout] = &[
    service(
        ROBOT_STATE,
        &RobotState::LAYOUT,
        ["the state publisher", "the controller"],
        ServiceBounds::new(1, OBSERVER_BUFFER),
    ),
    service(
        TASK_FRAMES,
        &TaskFrames::LAYOUT,
        ["the state publisher and other sources of frames", "the controller"],
        ServiceBounds::new(FRAME_SOURCES_MAX, 1),
    ),
    service(
        JOINT_COMMAND,
        &JointCommand::LAYOUT,
        ["the controller", "the robot"],
        ServiceBounds::new(1, 1),
    ),
    service(
        CONTROLLER_STATUS,
        &ControllerStatus::LAYOUT,
        ["the controller", "anyone"],
        ServiceBounds::new(1, OBSERVER_BUFFER),
    ),
    service(
        TOOL_COMMAND,
        &ToolCommand::LAYOUT,
        ["whoever commands the tool", "the controller"],
        ServiceBounds::new(1, 1),
    ),
];

/// The bounds of the service of a topic.
pub(crate) fn bounds(topic: &str) -> ServiceBounds {
    let service = SERVICES.iter().find(|service| service.topic == topic);
    service.map(|service| service.bounds).expect("every topic is in the table")
}

/// Another version of iceoryx2 that has made one of these files in shared memory, where one has.
pub(crate) fn other_version(files: &[PathBuf]) -> Option<String> {
    let versions = files.iter().filter(|path| path.extension().is_some_and(|e| e == "dynamic"));
    let read = |path: &PathBuf| {
        let mut bytes = [0; 8];
        std::fs::File::open(path).ok()?.read_exact(&mut bytes).ok()?;
        let word = u64::from_ne_bytes(bytes);
        Some([word >> 32, (word >> 16) & 0xffff, word & 0xffff])
    };
    let other =
        versions.filter_map(read).find(|version| *version != VERSION && version[0] < 100)?;
    let [major, minor, patch] = other;
    Some(format!("{major}.{minor}.{patch}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Instance, JointCommand, OBSERVER_BUFFER, RobotState};
    use iceoryx2::prelude::*;

    #[test]
    fn another_version_is_read_from_what_it_left() {
        let instance = Instance::new(&format!("version-{}", std::process::id())).unwrap();
        let _robot = instance.open_state_publisher().unwrap();
        let files = instance.shared_files();
        assert!(files.iter().any(|path| path.extension().is_some_and(|e| e == "dynamic")));
        assert_eq!(other_version(&files), None);
        let name = format!("tprmp-version-{}.dynamic", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::write(&path, ((10_u64 << 16) | 1).to_ne_bytes()).unwrap();
        let found = other_version(std::slice::from_ref(&path));
        std::fs::remove_file(path).unwrap();
        assert_eq!(found.as_deref(), Some("0.10.1"));
    }

    fn instance(test: &str) -> Instance {
        Instance::new(&format!("{test}-{}", std::process::id())).unwrap()
    }

    /// Whoever comes first: another bound is an error of whoever comes second, with both bounds.
    #[test]
    fn a_service_of_other_bounds_is_refused_with_what_was_expected_and_found() {
        for (publishers, buffer) in [(2, OBSERVER_BUFFER), (1, 1), (1, 2 * OBSERVER_BUFFER)] {
            let instance = instance(&format!("bounds-{publishers}-{buffer}"));
            let theirs = instance.open(|node| {
                let name: ServiceName =
                    format!("{}/robot_state/v1", instance.name()).as_str().try_into().unwrap();
                let service = node
                    .service_builder(&name)
                    .publish_subscribe::<RobotState>()
                    .max_publishers(publishers)
                    .max_subscribers(8)
                    .max_nodes(16)
                    .history_size(1)
                    .subscriber_max_buffer_size(buffer)
                    .create();
                Ok(service.unwrap())
            });
            let error = instance.open_controller().unwrap_err().to_string();
            let found = format!("found max_publishers {publishers}");
            assert!(error.contains("expected max_publishers 1,"), "{error}");
            assert!(error.contains(&found) && error.contains(&format!(" {buffer},")), "{error}");
            drop(theirs);
        }
    }

    #[test]
    fn a_message_of_another_size_is_named_on_both_sides() {
        let instance = instance("type");
        let theirs = instance.open(|node| {
            let name: ServiceName =
                format!("{}/robot_state/v1", instance.name()).as_str().try_into().unwrap();
            Ok(node.service_builder(&name).publish_subscribe::<JointCommand>().create().unwrap())
        });
        let error = instance.open_controller().unwrap_err().to_string();
        assert!(error.contains("RobotState of 232 bytes"), "{error}");
        assert!(error.contains("found JointCommandV1 of 368 bytes"), "{error}");
        drop(theirs);
    }
}
