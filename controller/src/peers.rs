//! The ports of the loop, and what connecting to new peers costs.

use tprmp_messages::ControllerPorts;

use crate::timing::allocation;
use crate::timing::realtime::monotonic_ns;

/// What connecting to peers that appeared or came back has cost.
#[derive(Debug, Clone, Copy, Default)]
pub struct Connections {
    /// How often something had to be connected.
    pub count: u64,
    /// Heap allocations in it.
    pub allocations: u64,
    /// Time it took, all together \[ns\].
    pub total_ns: u64,
    /// The longest time it took \[ns\].
    pub longest_ns: u64,
}

impl Connections {
    /// Counts one. No allocation.
    pub fn add(&mut self, allocations: u64, duration_ns: u64) {
        self.count += 1;
        self.allocations += allocations;
        self.total_ns += duration_ns;
        self.longest_ns = self.longest_ns.max(duration_ns);
    }
}

/// Everybody that the loop exchanges messages with.
#[derive(Debug)]
pub struct Peers {
    ports: ControllerPorts,
    connections: Connections,
    allocations_before: u64,
}

impl Peers {
    /// Nothing was exchanged yet.
    #[must_use]
    pub fn new(ports: ControllerPorts) -> Self {
        Self { ports, connections: Connections::default(), allocations_before: 0 }
    }

    /// Counts anew from here on.
    pub fn begin(&mut self) {
        self.connections = Connections::default();
        self.allocations_before = allocation::counted();
    }

    /// The ports, for an exchange that is not counted.
    #[must_use]
    pub fn ports(&self) -> &ControllerPorts {
        &self.ports
    }

    /// Exchanges messages. What allocates in it is a connection to a new peer: nothing else in
    /// iceoryx2 0.9.3 does, which the tests of this crate verify.
    pub fn exchange<T>(&mut self, work: impl FnOnce(&ControllerPorts) -> T) -> T {
        let (before, since_ns) = (allocation::counted(), monotonic_ns());
        let result = work(&self.ports);
        let allocations = allocation::counted() - before;
        if allocations > 0 {
            self.connections.add(allocations, monotonic_ns() - since_ns);
        }
        result
    }

    /// Connects to new peers. A connection that fails, for instance in full shared memory, is tried again when
    /// a peer comes or goes.
    pub fn connect_to_new(&mut self) {
        let _ = self.exchange(ControllerPorts::update_connections);
    }

    /// Heap allocations of this thread since the beginning, without those that connected a peer.
    #[must_use]
    pub fn allocations(&self) -> u64 {
        let all = allocation::counted() - self.allocations_before;
        all.saturating_sub(self.connections.allocations)
    }

    /// The connections made since the beginning.
    #[must_use]
    pub fn connections(&self) -> Connections {
        self.connections
    }
}
