//! Tests of several processes together: learner, controller and the state publishers, as a user
//! starts them.

mod bad_input;
mod command;
mod common;
mod conformance;
mod control;
mod cover;
mod crashes;
mod examples;
mod fault_matrix;
mod faults;
mod files;
mod guard;
mod init;
mod lockstep;
mod parts;
mod realtime;
mod record;
mod record_noise;
mod restarts;
mod robot;
mod shared_memory;
mod sources;
mod stop;
