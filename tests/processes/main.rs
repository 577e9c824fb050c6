//! Tests of several processes together: learner, controller and the state publishers, as a user
//! starts them.

mod bad_input;
mod common;
mod lockstep;
mod record;
mod stop;
