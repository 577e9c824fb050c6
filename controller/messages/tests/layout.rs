//! The tables say what is on the wire.

use tprmp_messages::{
    ControllerStatus, FieldLayout, Frame, GripperState, JointCommand, MESSAGES, Obstacle,
    RobotState, Scalar, TaskFrames, ToolCommand,
};

#[test]
fn sizes_are_those_other_languages_were_told() {
    assert_eq!(size_of::<RobotState>(), 232);
    assert_eq!(size_of::<Frame>(), 136);
    assert_eq!(size_of::<Obstacle>(), 136);
    assert_eq!(size_of::<TaskFrames>(), 48 + 8 * 136 + 32 * 136);
    assert_eq!(size_of::<JointCommand>(), 368);
    assert_eq!(size_of::<ToolCommand>(), 64);
    assert_eq!(size_of::<ControllerStatus>(), 144);
}

#[test]
fn tables_say_what_is_on_the_wire() {
    let [.., frames, obstacles] = TaskFrames::LAYOUT.fields else { panic!("no fields") };
    assert_eq!((frames.field, frames.offset, frames.size), ("frames", 48, 8 * 136));
    assert_eq!((obstacles.scalar, obstacles.count), (Scalar::Message("Obstacle"), Some(32)));
    assert_eq!(RobotState::LAYOUT.type_name, "RobotStateV3");
    assert_eq!(GripperState::LAYOUT.values[2].name, "Holding");
    assert_eq!(GripperState::default(), GripperState::None);
    let documented = |field: &FieldLayout| !field.doc.is_empty();
    assert!(MESSAGES.iter().flat_map(|message| message.fields).all(documented));
}
