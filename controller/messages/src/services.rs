//! Opening the services of an instance, with errors a user can act on.

use core::fmt::Debug;
use std::path::PathBuf;

use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError as OpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::bounds::{
    CONTROLLER_STATUS, JOINT_COMMAND, OBSERVER_BUFFER, ROBOT_STATE, STATE_BUFFER, ServiceBounds,
    TASK_FRAMES, TOOL_COMMAND, bounds, other_version,
};
use crate::error::ServiceError;
use crate::files::{Cleaned, Files, names_with_files};
use crate::ports::{
    ControllerPorts, FrameSourcePort, FramesPort, Leftovers, NodeGuard, ObserverPorts, Publisher,
    StatePublisherPorts, StatusPort, Subscriber, ToolCommandPort,
};
use crate::shared_memory::{free_shared_memory_bytes, refused_reservations};

/// One running system: a robot, its publisher and its controller share an instance name.
#[derive(Debug, Clone)]
pub struct Instance {
    name: String,
    files: Files,
    config: Config,
}

impl Instance {
    /// The instance of this name.
    ///
    /// Its files are `/dev/shm/tprmp_<user id>_<name>_*` and the folder `/tmp/tprmp-<user id>/<name>/`,
    /// readable and writable by this user only: two users may each have an instance of one name.
    ///
    /// # Errors
    /// When the name cannot be part of a service's name.
    pub fn new(name: &str) -> Result<Self, ServiceError> {
        // No underscore: it ends the name in those of the instance's files.
        let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-';
        let bad_name = || ServiceError::InstanceName(name.into());
        if name.is_empty() || name.len() > 32 || !name.chars().all(allowed) {
            return Err(bad_name());
        }
        let files = Files::new(name);
        let mut config = Config::default();
        config.global.prefix = FileName::new(files.prefix.as_bytes()).map_err(|_| bad_name())?;
        let root = format!("{}/", files.folder.display());
        config.global.set_root_path(&Path::new(root.as_bytes()).map_err(|_| bad_name())?);
        Ok(Self { name: name.into(), files, config })
    }

    /// All instances of which this user has files, running or not, in the order of their names.
    #[must_use]
    pub fn all() -> Vec<Self> {
        names_with_files().iter().filter_map(|name| Self::new(name).ok()).collect()
    }

    /// Its folder; it exists while something of the instance is open.
    #[must_use]
    pub fn folder(&self) -> PathBuf {
        self.files.folder.clone()
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Removes what killed processes left behind, and nothing of the living. It can be called at any time.
    ///
    /// # Errors
    /// When the files are not this user's, or cannot be removed.
    pub fn clean(&self) -> Result<Cleaned, ServiceError> {
        set_log_level(LogLevel::Fatal);
        self.files.clean(&self.config)
    }

    /// Opens ports, once there is room for them and the files are known to be this user's own. What does not
    /// fit after all is an error, too, and nothing of it stays.
    pub(crate) fn open<P>(
        &self,
        ports: impl FnOnce(&Node<ipc::Service>) -> Result<P, ServiceError>,
    ) -> Result<(P, NodeGuard), ServiceError> {
        let lock = self.files.claim()?;
        // Where nothing is opened, what is left over is removed without the lock, which that takes itself.
        let leftovers = Leftovers(self.files.clone());
        let opened = reserved(|| {
            free_shared_memory_bytes()?;
            let node = self.node()?;
            let ports = ports(&node)?;
            Ok((ports, node))
        });
        drop(lock);
        let (ports, node) = opened?;
        Ok((ports, NodeGuard { node, leftovers }))
    }

    fn node(&self) -> Result<Node<ipc::Service>, ServiceError> {
        set_log_level(LogLevel::Error);
        NodeBuilder::new()
            .config(&self.config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| ServiceError::Node(e, self.files.folder.display().to_string()))
    }

    fn service<M: Debug + ZeroCopySend + 'static>(
        &self,
        node: &Node<ipc::Service>,
        topic: &str,
    ) -> Result<(String, PortFactory<ipc::Service, M, ()>), ServiceError> {
        let name = format!("{}/{topic}/v1", self.name);
        let service_name: ServiceName =
            name.as_str().try_into().expect("an instance's name and a topic make a service's name");
        let wanted = bounds(topic);
        let service = node
            .service_builder(&service_name)
            .publish_subscribe::<M>()
            .max_publishers(wanted.publishers)
            .max_subscribers(wanted.subscribers)
            .max_nodes(wanted.nodes)
            .history_size(wanted.history)
            .subscriber_max_buffer_size(wanted.buffer)
            .enable_safe_overflow(wanted.overflow)
            .open_or_create()
            .map_err(|error| self.open_error::<M>(&name, topic, error))?;
        let found = ServiceBounds::of(service.static_config());
        if found != wanted {
            return Err(ServiceError::Bounds { service: name, expected: wanted, found });
        }
        Ok((name, service))
    }

    /// An error in opening the service, with what the other side has.
    fn open_error<M>(
        &self,
        service: &str,
        topic: &str,
        error: PublishSubscribeOpenOrCreateError,
    ) -> ServiceError {
        use PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError as Open;
        if let Some(found) = other_version(&self.files.shared()) {
            return ServiceError::Version { service: service.into(), found };
        }
        let pattern = MessagingPattern::PublishSubscribe;
        let name = ServiceName::new(service).ok();
        let details = name
            .and_then(|name| ipc::Service::details(&name, &self.config, pattern).ok().flatten());
        let found = details.map(|details| *details.static_details.publish_subscribe());
        match (error, found) {
            (Open(OpenError::IncompatibleTypes), found) => ServiceError::Incompatible {
                service: service.into(),
                message: core::any::type_name::<M>().rsplit("::").next().unwrap_or("?"),
                size: size_of::<M>(),
                found: found.map_or("another type".into(), |found| {
                    let payload = &found.message_type_details().payload;
                    format!("{} of {} bytes", payload.type_name(), payload.size())
                }),
            },
            (_, Some(found)) if ServiceBounds::of(&found) != bounds(topic) => {
                let (expected, found) = (bounds(topic), ServiceBounds::of(&found));
                ServiceError::Bounds { service: service.into(), expected, found }
            }
            (other, _) => ServiceError::Open(service.into(), other),
        }
    }

    /// Its files in shared memory.
    #[cfg(test)]
    pub(crate) fn shared_files(&self) -> Vec<PathBuf> {
        self.files.shared()
    }

    fn publisher<M: Debug + ZeroCopySend + 'static>(
        &self,
        node: &Node<ipc::Service>,
        topic: &str,
    ) -> Result<Publisher<M>, ServiceError> {
        let (name, service) = self.service::<M>(node, topic)?;
        service.publisher_builder().create().map(Publisher).map_err(|error| match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => {
                if topic == TASK_FRAMES {
                    ServiceError::TooManySources(name)
                } else {
                    ServiceError::SecondPublisher(name)
                }
            }
            other => ServiceError::Publisher(name, other),
        })
    }

    fn subscriber<M: Debug + ZeroCopySend + 'static>(
        &self,
        node: &Node<ipc::Service>,
        topic: &str,
        buffer: usize,
    ) -> Result<Subscriber<M>, ServiceError> {
        let (name, service) = self.service::<M>(node, topic)?;
        let subscriber = service.subscriber_builder().buffer_size(buffer).create();
        subscriber.map(Subscriber).map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                ServiceError::TooManySubscribers(name)
            }
            other => ServiceError::Subscriber(name, other),
        })
    }

    /// Opens the controller's side.
    ///
    /// # Errors
    /// See [`ServiceError`]; a second controller of the same instance is one.
    pub fn open_controller(&self) -> Result<ControllerPorts, ServiceError> {
        let ((command, status, state, frames), node) = self.open(|node| {
            Ok((
                self.publisher(node, JOINT_COMMAND)?,
                self.publisher(node, CONTROLLER_STATUS)?,
                self.subscriber(node, ROBOT_STATE, STATE_BUFFER)?,
                self.subscriber(node, TASK_FRAMES, 1)?,
            ))
        })?;
        Ok(ControllerPorts { state, frames, command, status, tool_command: None, node })
    }

    /// Opens the side of a state publisher: a simulator, or the driver of a real robot.
    ///
    /// # Errors
    /// See [`ServiceError`]; a second state publisher of the same instance is one.
    pub fn open_state_publisher(&self) -> Result<StatePublisherPorts, ServiceError> {
        let ((state, frames, command, status), _node) = self.open(|node| {
            Ok((
                self.publisher(node, ROBOT_STATE)?,
                self.publisher(node, TASK_FRAMES)?,
                self.subscriber(node, JOINT_COMMAND, 1)?,
                self.subscriber(node, CONTROLLER_STATUS, 1)?,
            ))
        })?;
        Ok(StatePublisherPorts { state, frames, command, status, _node })
    }

    /// Opens the side of an observer of states and frames: it publishes nothing, and neither a
    /// publisher nor a controller has to be there.
    ///
    /// # Errors
    /// See [`ServiceError`].
    pub fn open_observer(&self) -> Result<ObserverPorts, ServiceError> {
        let ((state, frames), _node) = self.open(|node| {
            Ok((
                self.subscriber(node, ROBOT_STATE, OBSERVER_BUFFER)?,
                self.subscriber(node, TASK_FRAMES, 1)?,
            ))
        })?;
        Ok(ObserverPorts { state, frames, _node })
    }

    /// Opens the side of a source of frames and obstacles beside the state publisher's: a camera, a tracker,
    /// a table that stands still. There may be [`FRAME_SOURCES_MAX`](crate::FRAME_SOURCES_MAX) of them, each of
    /// which sets a [`TaskFrames::source`](crate::TaskFrames::source) of its own.
    ///
    /// # Errors
    /// See [`ServiceError`]; a source too many is one.
    pub fn open_frame_source(&self) -> Result<FrameSourcePort, ServiceError> {
        let (frames, _node) = self.open(|node| self.publisher(node, TASK_FRAMES))?;
        Ok(FrameSourcePort { frames, _node })
    }

    /// Opens the side of a reader of frames and obstacles.
    ///
    /// # Errors
    /// See [`ServiceError`].
    pub fn open_frames(&self) -> Result<FramesPort, ServiceError> {
        let (frames, _node) = self.open(|node| self.subscriber(node, TASK_FRAMES, 1))?;
        Ok(FramesPort { frames, _node })
    }

    /// Opens the side of an external command of the tool, beside the skill. A controller need not be there,
    /// nor listen.
    ///
    /// # Errors
    /// See [`ServiceError`]; a second one who commands the same instance is one.
    pub fn open_tool_command(&self) -> Result<ToolCommandPort, ServiceError> {
        let (command, _node) = self.open(|node| self.publisher(node, TOOL_COMMAND))?;
        Ok(ToolCommandPort { command, _node })
    }

    /// Opens the side of a reader of the controller's status, whether it is there or not.
    ///
    /// # Errors
    /// See [`ServiceError`].
    pub fn open_status(&self) -> Result<StatusPort, ServiceError> {
        let (status, _node) =
            self.open(|node| self.subscriber(node, CONTROLLER_STATUS, OBSERVER_BUFFER))?;
        Ok(StatusPort { status, _node })
    }
}

/// Does what creates files in shared memory. That one of them did not fit is the reason of whatever else
/// went wrong, and an error where iceoryx2 makes none of it.
fn reserved<T>(create: impl FnOnce() -> Result<T, ServiceError>) -> Result<T, ServiceError> {
    let before = refused_reservations();
    let result = create();
    if refused_reservations() == before {
        return result;
    }
    // What was created is dropped first.
    drop(result);
    let free = free_shared_memory_bytes()?;
    Err(ServiceError::SharedMemoryFilled { free })
}

impl ControllerPorts {
    /// Listens to external commands, now or later.
    ///
    /// # Errors
    /// See [`ServiceError`].
    pub fn listen(&mut self, instance: &Instance) -> Result<(), ServiceError> {
        let port = reserved(|| instance.subscriber(&self.node.node, TOOL_COMMAND, 1))?;
        self.tool_command = Some(port);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounds::SUBSCRIBERS_MAX;
    use crate::messages::{ControllerStatus, JointCommand, RobotState, TaskFrames, ToolCommand};

    fn instance(test: &str) -> Instance {
        Instance::new(&format!("{test}-{}", std::process::id())).unwrap()
    }

    #[test]
    fn messages_travel_both_ways_and_only_the_newest_are_kept() {
        let instance = instance("travel");
        let robot = instance.open_state_publisher().unwrap();
        let controller = instance.open_controller().unwrap();
        let kept = STATE_BUFFER as u64;
        for sequence in 1..=3 * kept {
            assert!(robot.state.publish(RobotState { sequence, ..Default::default() }));
            assert!(robot.frames.publish(TaskFrames { sequence, ..Default::default() }));
        }
        for sequence in 2 * kept + 1..=3 * kept {
            assert_eq!(controller.state.receive().unwrap().sequence, sequence);
        }
        assert!(controller.state.receive().is_none());
        assert_eq!(controller.frames.receive().unwrap().sequence, 3 * kept);
        assert!(controller.frames.receive().is_none());
        assert!(controller.command.publish(JointCommand { sequence: 7, ..Default::default() }));
        assert_eq!(robot.command.receive().unwrap().sequence, 7);
    }

    #[test]
    fn an_observer_gets_each_state_beside_a_controller_and_the_newest_when_it_is_slow() {
        let instance = instance("observe");
        let observer = instance.open_observer().unwrap();
        let robot = instance.open_state_publisher().unwrap();
        let controller = instance.open_controller().unwrap();
        let publish = |sequences: core::ops::RangeInclusive<u64>| {
            for sequence in sequences {
                assert!(robot.state.publish(RobotState { sequence, ..Default::default() }));
            }
        };
        let kept = OBSERVER_BUFFER as u64;
        let received = || -> Vec<u64> {
            std::iter::from_fn(|| observer.state.receive().map(|s| s.sequence)).collect()
        };
        publish(1..=kept);
        assert_eq!(received(), (1..=kept).collect::<Vec<_>>());
        let newest = || -> Option<u64> {
            std::iter::from_fn(|| controller.state.receive().map(|s| s.sequence)).last()
        };
        assert_eq!(newest(), Some(kept));
        publish(kept + 1..=3 * kept);
        assert_eq!(received(), (2 * kept + 1..=3 * kept).collect::<Vec<_>>());
        assert_eq!(newest(), Some(3 * kept));
    }

    #[test]
    fn a_reader_of_the_status_gets_each_of_them_beside_a_robot() {
        let instance = instance("status");
        let reader = instance.open_status().unwrap();
        let robot = instance.open_state_publisher().unwrap();
        let controller = instance.open_controller().unwrap();
        for sequence in 1..=OBSERVER_BUFFER as u64 {
            let status = ControllerStatus { sequence, ..Default::default() };
            assert!(controller.status.publish(status));
        }
        for sequence in 1..=OBSERVER_BUFFER as u64 {
            assert_eq!(reader.status.receive().unwrap().sequence, sequence);
        }
        assert_eq!(robot.status.receive().unwrap().sequence, OBSERVER_BUFFER as u64);
    }

    #[test]
    fn a_reader_too_many_is_refused_with_a_reason() {
        let instance = instance("many");
        let readers: Vec<_> =
            (0..SUBSCRIBERS_MAX).map(|_| instance.open_observer().unwrap()).collect();
        let error = instance.open_observer().unwrap_err();
        assert!(matches!(error, ServiceError::TooManySubscribers(_)), "{error}");
        drop(readers);
        assert!(instance.open_observer().is_ok());
    }

    #[test]
    fn a_late_controller_gets_the_last_state() {
        let instance = instance("late");
        let robot = instance.open_state_publisher().unwrap();
        assert!(robot.state.publish(RobotState { sequence: 5, ..Default::default() }));
        let controller = instance.open_controller().unwrap();
        assert!(robot.state.update_connections());
        assert_eq!(controller.state.receive().unwrap().sequence, 5);
    }

    #[test]
    fn a_second_controller_or_publisher_is_refused_with_a_reason() {
        let instance = instance("second");
        let _robot = instance.open_state_publisher().unwrap();
        let error = instance.open_state_publisher().unwrap_err();
        assert!(matches!(error, ServiceError::SecondPublisher(_)), "{error}");
        let _controller = instance.open_controller().unwrap();
        assert!(instance.open_controller().unwrap_err().to_string().contains("already has"));
    }

    #[test]
    fn a_controller_receives_commands_only_when_it_listens_and_from_one_only() {
        let instance = instance("external");
        let mut controller = instance.open_controller().unwrap();
        assert!(controller.tool_command.is_none());
        let commander = instance.open_tool_command().unwrap();
        let send = |sequence| {
            assert!(commander.command.publish(ToolCommand { sequence, ..Default::default() }));
        };
        send(1);
        controller.listen(&instance).unwrap();
        send(2);
        let listener = controller.tool_command.as_ref().unwrap();
        assert_eq!(listener.receive().unwrap().sequence, 2);
        let error = instance.open_tool_command().unwrap_err();
        assert!(matches!(error, ServiceError::SecondPublisher(_)), "{error}");
        send(3);
        assert_eq!(listener.receive().unwrap().sequence, 3, "the first one goes on");
        drop(commander);
        assert!(instance.open_tool_command().is_ok());
    }

    #[test]
    fn names_that_could_leave_the_folder_are_refused() {
        for bad in ["", "a/b", "..", "a b", "a_b", &"x".repeat(33)] {
            assert!(matches!(Instance::new(bad), Err(ServiceError::InstanceName(_))), "{bad}");
        }
    }

    #[test]
    fn closed_ports_leave_no_files() {
        let instance = instance("clean");
        {
            let _robot = instance.open_state_publisher().unwrap();
            assert!(!instance.files.shared().is_empty());
        }
        assert!(instance.files.shared().is_empty());
        assert!(!instance.files.folder.exists());
    }
}
