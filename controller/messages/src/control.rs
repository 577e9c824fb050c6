//! Requests to a running controller, and its answers: by request and response, off the loop.

use core::fmt::Debug;
use std::time::{Duration, Instant};

use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::request_response::PortFactory;

use crate::bounds::SUBSCRIBERS_MAX;
use crate::checks::unpadded;
use crate::error::ServiceError;
use crate::layout::{message, wire_enum};
use crate::ports::NodeGuard;
use crate::services::Instance;

/// Longest text of a request or an answer, in bytes of UTF-8; shorter ones are padded with zeros.
pub const TEXT_CAPACITY: usize = 1000;

wire_enum! {
    /// What somebody asks of a controller.
    ControlVerb {
        /// Nothing: the answer tells how it is.
        Status = 0,
        /// Go on, from waiting for a start or from a hold.
        Start = 1,
        /// Decelerate to rest and hold, until a start.
        Hold = 2,
        /// Ramp down and leave.
        Stop = 3,
        /// Somebody has looked: forget the fault.
        Reset = 4,
        /// Follow the model in the file of the text.
        SwapModel = 5,
        /// Change the setting of the text to the value.
        Set = 6,
    }
}

message! {
    /// A request.
    struct ControlRequest = "ControlRequestV1" {
        /// A [`ControlVerb`].
        verb: u32,
        /// Explicit padding, zero.
        padding: u32,
        /// For [`ControlVerb::Set`], in the unit of the setting.
        value: f64,
        /// The path of a model, or the name of a setting.
        text: [u8; TEXT_CAPACITY],
    }
}

message! {
    /// An answer.
    struct ControlAnswer = "ControlAnswerV1" {
        /// 1 when the request was taken, 0 when it was refused.
        accepted: u32,
        /// A [`crate::LifeCycle`].
        life_cycle: u32,
        /// A [`crate::Reason`].
        reason: u32,
        /// Explicit padding, zero.
        padding: u32,
        /// For people: what was done, or why it was not.
        text: [u8; TEXT_CAPACITY],
    }
}

impl ControlRequest {
    /// A request; a text that is too long is cut.
    #[must_use]
    pub fn new(verb: ControlVerb, text: &str, value: f64) -> Self {
        Self { verb: verb.to_wire(), padding: 0, value, text: to_wire(text) }
    }
}

impl ControlAnswer {
    /// An answer; a text that is too long is cut.
    #[must_use]
    pub fn new(accepted: bool, text: &str) -> Self {
        Self {
            accepted: accepted.into(),
            life_cycle: 0,
            reason: 0,
            padding: 0,
            text: to_wire(text),
        }
    }
}

fn to_wire(text: &str) -> [u8; TEXT_CAPACITY] {
    let mut bytes = [0; TEXT_CAPACITY];
    let mut end = text.len().min(TEXT_CAPACITY);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
    bytes
}

/// A text from the wire; what is no UTF-8 is replaced.
#[must_use]
pub fn control_text(bytes: &[u8; TEXT_CAPACITY]) -> String {
    String::from_utf8_lossy(unpadded(bytes)).into_owned()
}

/// The controller's side of requests: a thread beside the loop asks it. Dropped, it leaves no files behind.
#[derive(Debug)]
pub struct ControlServer {
    server: Server<ipc::Service, ControlRequest, (), ControlAnswer, ()>,
    _node: NodeGuard,
}

impl ControlServer {
    /// Answers every request that has arrived. A connection that fails is the asking side's to notice.
    pub fn serve(&self, mut answer: impl FnMut(&ControlRequest) -> ControlAnswer) {
        while let Ok(Some(request)) = self.server.receive() {
            let _ = request.send_copy(answer(request.payload()));
        }
    }
}

/// The asking side. Dropped, it leaves no files behind.
#[derive(Debug)]
pub struct ControlClient {
    client: Client<ipc::Service, ControlRequest, (), ControlAnswer, ()>,
    _node: NodeGuard,
}

impl ControlClient {
    /// Sends a request and waits at most `patience` for the answer; `None` when there is none, or nobody to
    /// give one.
    #[must_use]
    pub fn ask(&self, request: &ControlRequest, patience: Duration) -> Option<ControlAnswer> {
        let pending = self.client.send_copy(*request).ok()?;
        let start = Instant::now();
        while start.elapsed() < patience {
            if let Ok(Some(answer)) = pending.receive() {
                return Some(*answer);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        None
    }
}

type Requests = PortFactory<ipc::Service, ControlRequest, (), ControlAnswer, ()>;

impl Instance {
    fn control(&self, node: &Node<ipc::Service>) -> Result<Requests, ServiceError> {
        let name = self.control_name();
        let service_name: ServiceName =
            name.as_str().try_into().expect("an instance's name and a topic make a service's name");
        let service = node
            .service_builder(&service_name)
            .request_response::<ControlRequest, ControlAnswer>()
            .max_servers(1)
            .max_clients(SUBSCRIBERS_MAX)
            .max_nodes(16)
            .open_or_create();
        service.map_err(|error| self.control_error(error))
    }

    fn control_name(&self) -> String {
        format!("{}/control/v1", self.name())
    }

    fn control_error(&self, error: impl Debug) -> ServiceError {
        ServiceError::Control(self.control_name(), format!("{error:?}"))
    }

    /// Opens the controller's side of requests.
    ///
    /// # Errors
    /// See [`ServiceError`]; a second controller of the same instance is one.
    pub fn open_control_server(&self) -> Result<ControlServer, ServiceError> {
        let (server, _node) = self.open(|node| {
            let server = self.control(node)?.server_builder().create();
            server.map_err(|error| self.control_error(error))
        })?;
        Ok(ControlServer { server, _node })
    }

    /// Opens the asking side of requests.
    ///
    /// # Errors
    /// See [`ServiceError`].
    pub fn open_control_client(&self) -> Result<ControlClient, ServiceError> {
        let (client, _node) = self.open(|node| {
            let client = self.control(node)?.client_builder().create();
            client.map_err(|error| self.control_error(error))
        })?;
        Ok(ControlClient { client, _node })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_survives_the_wire_and_a_long_one_is_cut_between_letters() {
        let request = ControlRequest::new(ControlVerb::SwapModel, "my/model.ron", 0.0);
        assert_eq!(control_text(&request.text), "my/model.ron");
        let long = "ä".repeat(TEXT_CAPACITY);
        assert_eq!(control_text(&to_wire(&long)), "ä".repeat(TEXT_CAPACITY / 2));
        assert_eq!(control_text(&[b'a'; TEXT_CAPACITY]).len(), TEXT_CAPACITY);
    }
}
