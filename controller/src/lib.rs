//! The hard-loop controller process.
