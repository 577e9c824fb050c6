//! The parts that a benchmark plays in processes of its own: it starts itself again with a role.
//!
//! A helper prints `ready` on its standard output, and stops when its standard input is closed: so it
//! stops too when the benchmark itself is ended.

use std::env;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use serde::{Deserialize, Serialize};
use tprmp_controller::timing::realtime::{monotonic_ns, sleep_until};
use tprmp_messages::{Instance, JointCommand};

use crate::robot::{Robot, Skill};
use crate::{Fallible, machine};

const ARGUMENT: &str = "--role";
/// A busy neighbour walks through so much memory: more than a core keeps for itself \[bytes\].
const NEIGHBOUR_BYTES: usize = 4 << 20;
/// The other end of a ping-pong spins for so long before it only polls \[ns\].
const PONG_SPIN_NS: u64 = 500_000;
const PONG_POLL_NS: u64 = 20_000;

/// A part to play.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Role {
    /// Publishes states and frames, and obeys the commands.
    Publisher {
        /// What the controller runs.
        skill: Skill,
        /// Name that publisher and controller share.
        instance: String,
        /// Time between two states \[ns\].
        period_ns: u64,
        /// Core.
        cpu: usize,
        /// Real-time priority.
        fifo_priority: Option<u8>,
    },
    /// Receives each state and its frames, and answers at once with a command: the bare
    /// middleware, with the messages of a controller.
    Pong {
        /// Name that both ends share.
        instance: String,
        /// After an answer it sleeps so long before it spins for the next state \[ns\].
        sleep_ns: u64,
        /// Core.
        cpu: usize,
        /// Real-time priority.
        fifo_priority: Option<u8>,
    },
    /// Computes, and walks through memory.
    Neighbour {
        /// Core.
        cpu: usize,
    },
}

/// A process that plays a role, until this is dropped.
#[derive(Debug)]
pub struct Helper {
    child: Child,
    stdin: Option<ChildStdin>,
}

impl Drop for Helper {
    fn drop(&mut self) {
        // Closes it: the helper stops.
        drop(self.stdin.take());
        // It cannot hang: its loops end with its input.
        let _ = self.child.wait();
    }
}

impl Role {
    /// Starts a process with this role and waits until it is ready.
    ///
    /// # Errors
    /// When it cannot be started, or ends before it is ready; it has then printed why.
    pub fn start(&self) -> Fallible<Helper> {
        let mut child = Command::new(env::current_exe()?)
            .args([ARGUMENT, &serde_json::to_string(self)?])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
        let helper = Helper { child, stdin };
        let mut line = String::new();
        BufReader::new(stdout.ok_or("no standard output")?).read_line(&mut line)?;
        if line != "ready\n" {
            return Err(format!("a helper ended before it was ready: {self:?}").into());
        }
        Ok(helper)
    }

    /// In a process that was started with a role: plays it. `false` in any other process.
    ///
    /// # Errors
    /// When the role cannot be played.
    pub fn play_if_asked() -> Fallible<bool> {
        let mut arguments = env::args().skip_while(|argument| argument != ARGUMENT);
        let (Some(_), Some(role)) = (arguments.next(), arguments.next()) else { return Ok(false) };
        let role: Self = serde_json::from_str(&role)?;
        role.play(&stop_at_end_of_input())?;
        Ok(true)
    }

    fn play(&self, stop: &AtomicBool) -> Fallible<()> {
        match self {
            Self::Publisher { skill, instance, period_ns, cpu, fifo_priority } => {
                let ports = Instance::new(instance)?.open_state_publisher()?;
                let _granted = machine::enter(*cpu, *fifo_priority);
                println!("ready");
                let mut robot = Robot::new(*skill);
                let mut due_ns = monotonic_ns();
                while !stop.load(Ordering::Relaxed) {
                    robot.obey(&ports);
                    robot.publish(&ports);
                    // What was missed is skipped.
                    let missed = monotonic_ns().saturating_sub(due_ns) / period_ns;
                    due_ns += (missed + 1) * period_ns;
                    sleep_until(due_ns);
                }
            }
            Self::Pong { instance, sleep_ns, cpu, fifo_priority } => {
                let ports = Instance::new(instance)?.open_controller()?;
                let _granted = machine::enter(*cpu, *fifo_priority);
                println!("ready");
                let mut answered_ns = monotonic_ns();
                while !stop.load(Ordering::Relaxed) {
                    if let Some(state) = ports.state.receive() {
                        let state_sequence = state.sequence;
                        core::hint::black_box(ports.frames.receive());
                        let answer = JointCommand { state_sequence, ..Default::default() };
                        let _ = ports.command.publish(answer);
                        answered_ns = monotonic_ns();
                        sleep_until(answered_ns + sleep_ns);
                    }
                    let now_ns = monotonic_ns();
                    if now_ns > answered_ns + sleep_ns + PONG_SPIN_NS {
                        let _ = ports.command.update_connections();
                        sleep_until(now_ns + PONG_POLL_NS);
                    }
                }
            }
            Self::Neighbour { cpu } => {
                let _granted = machine::enter(*cpu, None);
                println!("ready");
                let mut memory = vec![1_u64; NEIGHBOUR_BYTES / 8];
                while !stop.load(Ordering::Relaxed) {
                    for cell in memory.iter_mut().step_by(8) {
                        *cell = cell.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    }
                    core::hint::black_box(&memory);
                }
            }
        }
        Ok(())
    }
}

/// Set when the standard input ends.
fn stop_at_end_of_input() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    thread::spawn(move || {
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        asked.store(true, Ordering::Relaxed);
    });
    stop
}
