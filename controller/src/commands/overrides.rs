//! Settings of the configuration that a run may change: for trying out, and for benchmarks.

use clap::{Args, ValueEnum};
use tprmp_model::controller_config::{ControllerConfig, Trigger};

/// Each replaces the key of the same name; what comes out is validated like the file.
#[derive(Debug, Default, Clone, Args)]
#[command(next_help_heading = "Instead of what the configuration says")]
pub struct Overrides {
    /// loop.trigger: what wakes the loop.
    #[arg(long, value_enum)]
    pub trigger: Option<TriggerName>,
    /// loop.period_ns: period of the schedule, and deadline of a tick.
    #[arg(long, value_name = "NS")]
    pub period_ns: Option<u64>,
    /// loop.spin_ns: spin so long before the schedule, or around the expected state.
    #[arg(long, value_name = "NS")]
    pub spin_ns: Option<u64>,
    /// loop.status_every_ticks: publish the status once in so many ticks.
    #[arg(long, value_name = "N")]
    pub status_every_ticks: Option<u32>,
    /// real_time.fifo_priority: 1 to 99, or `none` for the ordinary scheduler.
    #[arg(long, value_name = "N|none", value_parser = number_or_none::<u8>)]
    pub fifo_priority: Option<OrNone<u8>>,
    /// real_time.cpu: the core that the loop is kept on, or `none`.
    #[arg(long, value_name = "N|none", value_parser = number_or_none::<usize>)]
    pub cpu: Option<OrNone<usize>>,
}

/// A number, or none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OrNone<T>(pub Option<T>);

/// The triggers, as they are named on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TriggerName {
    /// An absolute schedule of its own.
    Periodic,
    /// Each new state.
    OnState,
}

impl From<TriggerName> for Trigger {
    fn from(name: TriggerName) -> Self {
        match name {
            TriggerName::Periodic => Self::Periodic,
            TriggerName::OnState => Self::OnState,
        }
    }
}

fn number_or_none<T: core::str::FromStr>(text: &str) -> Result<OrNone<T>, String> {
    match text {
        "none" => Ok(OrNone(None)),
        text => text
            .parse()
            .map(|number| OrNone(Some(number)))
            .map_err(|_| "expected a whole number or `none`".into()),
    }
}

impl Overrides {
    /// Puts them into a configuration.
    pub fn apply(&self, config: &mut ControllerConfig) {
        fn replace<T>(key: &mut T, value: Option<T>) {
            if let Some(value) = value {
                *key = value;
            }
        }
        replace(&mut config.cycle.trigger, self.trigger.map(Trigger::from));
        replace(&mut config.cycle.period_ns, self.period_ns);
        replace(&mut config.cycle.spin_ns, self.spin_ns);
        replace(&mut config.cycle.status_every_ticks, self.status_every_ticks);
        replace(&mut config.real_time.fifo_priority, self.fifo_priority.map(|n| n.0));
        replace(&mut config.real_time.cpu, self.cpu.map(|n| n.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_none_and_nothing_else_is_understood() {
        assert_eq!(number_or_none::<u8>("80"), Ok(OrNone(Some(80))));
        assert_eq!(number_or_none::<u8>("none"), Ok(OrNone(None)));
        assert!(number_or_none::<u8>("-1").is_err());
        assert!(number_or_none::<usize>("").is_err());
    }
}
