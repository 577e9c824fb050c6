//! What is judged in motion: order and sign of the joints, velocities, torques, and how the robot reacts to
//! commands that expire, to `Stop`, and to a controller that is killed.

use nalgebra::SVector;
use tprmp_messages::{CommandMode, Reason};
use tprmp_model::controller_config::ControllerConfig;

use crate::commands::sentences::sentence;
use crate::conformance::mover::{Broken, Moment, Mover, Path};
use crate::conformance::table::{Check, Table, Verdict};

/// How long a joint takes out, and back \[s\].
const OUT_S: f64 = 1.0;
/// How long it takes where it is interrupted half way \[s\].
const FAST_S: f64 = 0.6;
/// How long is looked after an interruption \[s\].
const WATCH_S: f64 = 1.0;
/// A joint has followed when it has come at least so far, as a fraction of the amplitude …
const FOLLOWED: f64 = 0.6;
/// … and stayed when it has moved by less.
const STAYED: f64 = 0.3;
/// Velocities agree with positions within this fraction of a motion.
const AGREES: f64 = 0.3;
/// Since an interruption the arm goes on by less than this fraction of the amplitude; half of it was left.
pub(super) const GOES_ON: f64 = 0.35;

/// Judges motions, each once it was confirmed.
pub(super) struct Motions<'a, const N: usize> {
    pub(super) config: &'a ControllerConfig,
    /// Asks whether a motion may be made.
    pub(super) confirm: &'a dyn Fn(&str) -> bool,
}

impl<const N: usize> Motions<'_, N> {
    fn joint(&self, i: usize) -> String {
        format!("joint {} `{}`", i + 1, self.config.robot.joints[i])
    }

    /// Judges all of them but the killed controller; whether the arm obeys so far.
    pub(super) fn judge(&self, mover: &mut Mover<'_, N>, table: &mut Table) -> bool {
        if let Err(text) = mover.hold(0.3).map_err(|broken| self.broken(broken)) {
            table.add(Check::Joints, Verdict::Failed(format!("the arm cannot be held: {text}")));
            return false;
        }
        let mut traces: [Vec<Moment<N>>; N] = core::array::from_fn(|_| Vec::new());
        for (i, trace) in traces.iter_mut().enumerate() {
            if !(self.confirm)(&format!(
                "{} moves by {:.3} and back",
                self.joint(i),
                mover.amplitude(i)
            )) {
                table.add(Check::Joints, Verdict::NotTried("not confirmed".into()));
                return false;
            }
            mover.forget();
            let result = self.out_and_back(mover, i);
            trace.append(&mut mover.trace);
            if let Err((check, text)) = result {
                let check = if check == Check::Joints
                    && velocity(trace, i).is_err()
                    && moved(trace, i, mover)
                {
                    Check::Velocity
                } else {
                    check
                };
                table.add(check, Verdict::Failed(text));
                return false;
            }
        }
        let count = format!("all {N} joints follow, alone");
        table.add(Check::Joints, Verdict::Passed(count));
        let wrong = (0..N).find_map(|i| velocity(&traces[i], i).err().map(|text| (i, text)));
        table.judge(
            Check::Velocity,
            match wrong {
                None => Ok("agrees with the positions".into()),
                Some((i, text)) => Err(format!("{}: {text}", self.joint(i))),
            },
        );
        table.add(Check::Torque, self.torque(&traces));
        self.interrupted(mover, table, Check::Expiry) && self.interrupted(mover, table, Check::Stop)
    }

    fn broken(&self, broken: Broken) -> String {
        match broken {
            Broken::Stale => "no state for a second".into(),
            Broken::Refused(mode, stop) => {
                format!("the robot says meanwhile: `robot_mode` {mode}, `safety_stop` {stop}")
            }
            Broken::Faulty(reason) => {
                format!("meanwhile a state is refused: {}", sentence(reason).unwrap_or_default())
            }
            Broken::Interrupted => "interrupted by a signal; the arm was told to stop".into(),
            Broken::NotHeld => {
                "it does not come to rest where it is commanded to be within 5 s".into()
            }
            Broken::Fast(i, speed) => {
                format!("{} has a velocity of {speed:.2} rad/s or m/s", self.joint(i))
            }
            Broken::Astray(i, offset) => {
                format!("{} has moved by {offset:.4} rad or m", self.joint(i))
            }
        }
    }

    fn out_and_back(&self, mover: &mut Mover<'_, N>, i: usize) -> Result<(), (Check, String)> {
        let amplitude = mover.amplitude(i);
        let out = Path { joint: i, offsets: [0.0, amplitude], duration_s: OUT_S };
        let text = |mover: &mut Mover<'_, N>, broken: Broken| {
            // The arm comes to rest where it is, whatever else is wrong.
            mover.watch(0.3);
            let broken = self.likelier(mover, i, broken);
            let check = match broken {
                Broken::Fast(..) => Check::Velocity,
                Broken::Stale => Check::Rate,
                Broken::Refused(..) => Check::Modes,
                Broken::Faulty(Reason::JointCount) => Check::JointCount,
                Broken::Faulty(_) => Check::Numbers,
                Broken::NotHeld | Broken::Astray(..) | Broken::Interrupted => Check::Joints,
            };
            (check, self.astray(i, amplitude, broken))
        };
        if let Err(broken) = mover.go(&out, 0.0, OUT_S + 0.3, CommandMode::Track) {
            return Err(text(mover, broken));
        }
        let offset = mover.offset().unwrap_or_else(SVector::zeros);
        let shall = |j: usize| if j == i { amplitude } else { 0.0 };
        let wrong = (0..N).find(|&j| {
            let fraction = (offset[j] - shall(j)).abs() / mover.amplitude(j).abs();
            if j == i { offset[j] / amplitude < FOLLOWED } else { fraction > STAYED }
        });
        if let Some(j) = wrong {
            return Err(text(mover, Broken::Astray(j, offset[j])));
        }
        let back = Path { offsets: [amplitude, 0.0], ..out };
        let returned = mover.go(&back, 0.0, OUT_S + 0.3, CommandMode::Track);
        returned.map_err(|broken| text(mover, broken))
    }

    /// Where the joint that was commanded has not moved, the one that has moved in its place is what is wrong.
    fn likelier(&self, mover: &Mover<'_, N>, i: usize, broken: Broken) -> Broken {
        let (Broken::Astray(at, _), Some(offset)) = (broken, mover.offset()) else { return broken };
        let fraction = |j: usize| (offset[j] / mover.amplitude(j)).abs();
        let most = (0..N).filter(|j| *j != i).max_by(|a, b| fraction(*a).total_cmp(&fraction(*b)));
        match most {
            Some(j) if at == i && fraction(j) > STAYED && fraction(i) < STAYED => {
                Broken::Astray(j, offset[j])
            }
            _ => broken,
        }
    }

    fn astray(&self, i: usize, amplitude: f64, broken: Broken) -> String {
        let commanded = format!("{} was commanded to move by {amplitude:.4}", self.joint(i));
        let Broken::Astray(j, offset) = broken else {
            return format!("{commanded}: {}", self.broken(broken));
        };
        if j != i {
            let other = self.joint(j);
            format!("{commanded}, but {other} has moved by {offset:.4}: joints in another order")
        } else if offset / amplitude < -0.1 {
            format!("{commanded}, and has moved by {offset:.4}: the other sign")
        } else {
            format!("{commanded}, and has moved by {offset:.4}: it does not follow")
        }
    }

    fn torque(&self, traces: &[Vec<Moment<N>>; N]) -> Verdict {
        let mut agreement = Vec::new();
        for (i, trace) in traces.iter().enumerate() {
            let (mut with, mut size) = (0.0, 0.0);
            for moment in trace {
                with += moment.torque[i] * moment.commanded_torque[i];
                size += moment.commanded_torque[i] * moment.commanded_torque[i];
            }
            if trace.iter().any(|moment| moment.torque[i] != 0.0) && size > 0.0 {
                agreement.push((i, with / size));
            }
        }
        match agreement.iter().find(|(_, fraction)| *fraction < -0.1) {
            _ if agreement.is_empty() => {
                Verdict::NotTried("no torque is measured: all are zero".into())
            }
            None => Verdict::Passed("has the sign of what accelerates".into()),
            Some((i, fraction)) => Verdict::Failed(format!(
                "{} is {fraction:.2} times what was commanded: the other sign",
                self.joint(*i)
            )),
        }
    }

    /// Interrupts a motion half way: by no more commands, or by commands that say `Stop`.
    fn interrupted(&self, mover: &mut Mover<'_, N>, table: &mut Table, check: Check) -> bool {
        let what = format!(
            "{} moves by half of {:.3}, then: {}",
            self.joint(0),
            mover.amplitude(0),
            check.name()
        );
        if !(self.confirm)(&what) {
            table.add(check, Verdict::NotTried("not confirmed".into()));
            return false;
        }
        let amplitude = mover.amplitude(0);
        let out = Path { joint: 0, offsets: [0.0, amplitude], duration_s: FAST_S };
        let begun = mover.hold(0.2).and_then(|()| {
            let from = mover.offset().map_or(0.0, |offset| offset[0]);
            let back = Path { offsets: [from, 0.0], ..out };
            mover.go(&back, 0.0, FAST_S, CommandMode::Track)?;
            mover.go(&out, 0.0, 0.5 * FAST_S, CommandMode::Track)
        });
        if let Err(broken) = begun {
            table.add(check, Verdict::Failed(self.broken(broken)));
            return false;
        }
        mover.forget();
        if check == Check::Stop {
            // The other fields go on with the motion.
            let _ = mover.go(&out, 0.5 * FAST_S, WATCH_S, CommandMode::Stop);
            mover.watch(0.02);
        } else {
            mover.watch(WATCH_S);
        }
        let result = rests(&mover.trace, 0, amplitude);
        let held = result.is_ok();
        table.judge(check, result);
        held
    }
}

/// Whether a joint has moved at all.
fn moved<const N: usize>(trace: &[Moment<N>], i: usize, mover: &Mover<'_, N>) -> bool {
    let first = trace.first().map_or(0.0, |moment| moment.position[i]);
    let most = trace.iter().map(|moment| (moment.position[i] - first).abs()).fold(0.0, f64::max);
    most > STAYED * mover.amplitude(i).abs()
}

/// Whether the velocities of joint `i` say what its positions do, on the way out.
fn velocity<const N: usize>(trace: &[Moment<N>], i: usize) -> Result<(), String> {
    let Some(first) = trace.first() else { return Ok(()) };
    let mut sum = 0.0;
    // Where it is farthest from where it was.
    let (mut by_velocity, mut by_position) = (0.0, 0.0_f64);
    for pair in trace.windows(2) {
        let dt = pair[1].time_ns.saturating_sub(pair[0].time_ns) as f64 * 1e-9;
        sum += 0.5 * (pair[0].velocity[i] + pair[1].velocity[i]) * dt.min(0.1);
        let change = pair[1].position[i] - first.position[i];
        if change.abs() > by_position.abs() {
            (by_velocity, by_position) = (sum, change);
        }
    }
    let ratio = by_velocity / by_position;
    if by_position == 0.0 || (ratio - 1.0).abs() < AGREES {
        return Ok(());
    }
    let cause = match ratio {
        r if r.abs() < 0.05 => "it is not measured",
        r if (r + 1.0).abs() < AGREES => "it has the other sign",
        r if (r / 57.3 - 1.0).abs() < AGREES => "it is in degrees",
        r if (r / 1e3 - 1.0).abs() < AGREES => "it is in millimetres",
        _ => "another unit, or too strong a filter",
    };
    Err(format!(
        "its velocities add up to {by_velocity:.4}, its positions changed by {by_position:.4}: {cause}"
    ))
}

/// Whether joint `i` has come to rest, soon, of a motion of this amplitude that was interrupted half way.
pub(super) fn rests<const N: usize>(
    trace: &[Moment<N>],
    i: usize,
    amplitude: f64,
) -> Result<String, String> {
    let (Some(first), Some(last)) = (trace.first(), trace.last()) else {
        return Err("no state came afterwards".into());
    };
    let from_ns = last.time_ns.saturating_sub(300_000_000);
    let late = trace.iter().filter(|moment| moment.time_ns >= from_ns);
    let spread = late.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], moment| {
        [least.min(moment.position[i]), most.max(moment.position[i])]
    });
    let on = last.position[i] - first.position[i];
    let text = format!("it went on by {:.4} rad or m", on.abs());
    if spread[1] - spread[0] > 0.05 * amplitude.abs() {
        return Err(format!("{text} and still moves after {WATCH_S} s"));
    }
    if on.abs() > GOES_ON * amplitude.abs() {
        return Err(format!(
            "{text}, at most {:.4} are expected of one that brakes",
            GOES_ON * amplitude.abs()
        ));
    }
    Ok(format!("{text}, and rests"))
}
