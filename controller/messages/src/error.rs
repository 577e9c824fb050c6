//! Why the services of an instance could not be opened, in words a user can act on.

use std::io;
use std::path::PathBuf;

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenOrCreateError;
use thiserror::Error;

use crate::bounds::{FRAME_SOURCES_MAX, SUBSCRIBERS_MAX, ServiceBounds};
use crate::messages::JOINT_CAPACITY;
use crate::shared_memory::SharedMemoryFault;

/// Why the services of an instance could not be opened.
#[derive(Debug, Error)]
pub enum ServiceError {
    /// The name of the instance cannot be part of a service's name.
    #[error("instance name `{0}`: expected 1 to 32 of the characters a-z, A-Z, 0-9 and `-`")]
    InstanceName(String),
    /// Shared memory is missing or full.
    #[error(transparent)]
    SharedMemory(#[from] SharedMemoryFault),
    /// Shared memory became full while the services were opened.
    #[error(
        "/dev/shm became full while the services were opened, {free} bytes are free: remove what fills it \
         (`controller clean` removes what killed processes left), or `mount -o remount,size=64M /dev/shm`"
    )]
    SharedMemoryFilled {
        /// What is free now \[bytes\].
        free: u64,
    },
    /// Somebody else's file is in the way.
    #[error(
        "`{path}` belongs to user {owner}, not to user {user} who runs this: let its owner or root remove \
         it, or use another instance", path = path.display()
    )]
    Foreign {
        /// The file.
        path: PathBuf,
        /// User id of its owner.
        owner: u32,
        /// User id of this process.
        user: u32,
    },
    /// Others could put their files there, or change ours.
    #[error(
        "`{path}` can be written by others (mode {mode:03o}): see what lies there, then \
         `chmod -R go-w {path}` or remove it", path = path.display()
    )]
    OpenToOthers {
        /// The file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A link, or a file, in place of a folder.
    #[error("`{path}` is a link or a file in place of a folder: remove it", path = .0.display())]
    NoFolder(PathBuf),
    /// A folder of the instance cannot be made, looked at or emptied.
    #[error("`{path}`: {source}; check that /tmp is writable by this user", path = path.display())]
    Folder {
        /// The folder or file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Another process of this user opens, closes or cleans an instance, and does not come to an end.
    #[error(
        "`{path}` is locked by another process of this user, which does not let go: see which by \
         `fuser {path}`", path = .0.display()
    )]
    Locked(PathBuf),
    /// The node could not be created.
    #[error(
        "no shared-memory node could be created ({0}): check that {1} and /dev/shm are writable \
         by this user; `controller clean` removes what killed processes left"
    )]
    Node(NodeCreationFailure, String),
    /// A second publisher of the same service.
    #[error("service `{0}` already has a publisher: another one is running on this instance")]
    SecondPublisher(String),
    /// Every place of a source of frames is in use.
    #[error(
        "service `{0}` already has {FRAME_SOURCES_MAX} sources of frames, as many as it can have: end one"
    )]
    TooManySources(String),
    /// The other side was built with another layout of the message.
    #[error(
        "service `{service}`: expected this program's {message} of {size} bytes, found {found}: both sides \
         must be of the same version; `controller layout` lists every field"
    )]
    Incompatible {
        /// Name of the service.
        service: String,
        /// Name of the message's type on this side.
        message: &'static str,
        /// Its size on this side \[bytes\].
        size: usize,
        /// Type and size on the other side.
        found: String,
    },
    /// The other side was built with other bounds of the service.
    #[error(
        "service `{service}` exists with other bounds: expected {expected}; found {found}: make it with the \
         expected ones"
    )]
    Bounds {
        /// Name of the service.
        service: String,
        /// On this side.
        expected: ServiceBounds,
        /// On the other side.
        found: ServiceBounds,
    },
    /// The other side has another version of iceoryx2.
    #[error(
        "service `{service}` was made with iceoryx2 {found}, expected 0.9.3 exactly: versions do not talk to each \
         other; in Python `pip install iceoryx2==0.9.3`, then `controller clean`"
    )]
    Version {
        /// Name of the service.
        service: String,
        /// The version of the other side.
        found: String,
    },
    /// A robot of no joints, or of more than a message carries.
    #[error("a robot of {0} joints: expected 1 to {JOINT_CAPACITY}")]
    JointCount(usize),
    /// A message was not sent.
    #[error("shared memory refuses a message: `controller clean`, then open the instance again")]
    NotSent,
    /// Every place of a reader is taken.
    #[error("service `{0}` already has {SUBSCRIBERS_MAX} readers, as many as it can have: end one")]
    TooManySubscribers(String),
    /// Anything else that iceoryx2 reports of a service.
    #[error(
        "service `{0}` could not be opened: {1}; where another program has made it, likely by another version of \
         iceoryx2 than 0.9.3: end it, then `controller clean`"
    )]
    Open(String, PublishSubscribeOpenOrCreateError),
    /// What iceoryx2 reports of the requests' service.
    #[error(
        "service `{0}` could not be opened ({1}): where it exists with other types or bounds, both sides \
         must be of the same version"
    )]
    Control(String, String),
    /// Anything else that it reports of a publisher.
    #[error("service `{0}` could not be opened: {1}")]
    Publisher(String, PublisherCreateError),
    /// Anything else that it reports of a subscriber.
    #[error("service `{0}` could not be opened: {1}")]
    Subscriber(String, SubscriberCreateError),
}
