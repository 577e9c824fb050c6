//! The examples run.

#[path = "../examples/train.rs"]
#[allow(unreachable_pub, reason = "an example is a program of its own")]
mod train;

#[test]
fn a_model_is_trained_from_rust() {
    train::main().unwrap();
}
