//! Requests to a running controller, and its answers: by request and response, off the loop.

use iceoryx2::prelude::ZeroCopySend;

use crate::messages::wire_enum;

/// Longest text of a request or an answer, in bytes of UTF-8; shorter ones are padded with zeros.
pub const TEXT_CAPACITY: usize = 1000;

wire_enum! {
    /// What somebody asks of a controller.
    ControlVerb {
        /// Nothing: the answer tells how it is.
        #[default]
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

/// A request.
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[type_name("ControlRequestV1")]
#[repr(C)]
pub struct ControlRequest {
    /// A [`ControlVerb`].
    pub verb: u32,
    /// Explicit padding, zero.
    pub padding: u32,
    /// For [`ControlVerb::Set`], in the unit of the setting.
    pub value: f64,
    /// The path of a model, or the name of a setting.
    pub text: [u8; TEXT_CAPACITY],
}

/// An answer.
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[type_name("ControlAnswerV1")]
#[repr(C)]
pub struct ControlAnswer {
    /// 1 when the request was taken, 0 when it was refused.
    pub accepted: u32,
    /// A [`crate::LifeCycle`].
    pub life_cycle: u32,
    /// A [`crate::Reason`].
    pub reason: u32,
    /// Explicit padding, zero.
    pub padding: u32,
    /// For people: what was done, or why it was not.
    pub text: [u8; TEXT_CAPACITY],
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
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(TEXT_CAPACITY);
    String::from_utf8_lossy(&bytes[..end]).into_owned()
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
