//! Simulated network faults between a robot's controller and the PC.
//! Run by the clock thread; one time step is one cycle.

use serde::{Deserialize, Serialize};

use rcc_driver_kit::proxy::{FaultCounts, FaultRates, FaultyLink};

/// Fault rates of each direction.
#[derive(Clone, Copy, Debug, PartialEq, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NetworkRates {
    /// Measurement datagrams.
    pub to_pc: FaultRates,
    /// Answers of the PC.
    pub from_pc: FaultRates,
}

/// Fault counters since the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
pub struct NetworkCounts {
    /// Measurement datagrams.
    pub to_pc: FaultCounts,
    /// Answers of the PC.
    pub from_pc: FaultCounts,
}

/// The links of both directions.
#[derive(Clone, Debug)]
pub struct Network {
    rates: NetworkRates,
    to_pc: FaultyLink,
    from_pc: FaultyLink,
}

impl Network {
    /// A network without faults; `seed` determines the random numbers.
    #[must_use]
    pub fn new(seed: u64) -> Network {
        Network {
            rates: NetworkRates::default(),
            to_pc: FaultyLink::new(FaultRates::NONE, seed),
            from_pc: FaultyLink::new(FaultRates::NONE, seed ^ 1),
        }
    }

    /// Sets the fault rates, from now on; without any faults, queued datagrams are dropped.
    pub fn set(&mut self, rates: NetworkRates) {
        self.rates = rates;
        self.to_pc.set_rates(rates.to_pc);
        self.from_pc.set_rates(rates.from_pc);
        if self.is_clear() {
            self.to_pc.forget();
            self.from_pc.forget();
        }
    }

    /// Returns true if no faults are set.
    #[must_use]
    pub fn is_clear(&self) -> bool {
        self.rates == NetworkRates::default()
    }

    /// Starts a cycle.
    pub fn step(&mut self) {
        self.to_pc.step();
        self.from_pc.step();
    }

    /// Sends a measurement; returns the datagrams that arrive now, including delayed ones.
    pub fn to_pc(&mut self, datagram: &[u8]) -> Vec<Vec<u8>> {
        pass(&mut self.to_pc, datagram)
    }

    /// Receives an answer; returns the datagrams that arrive now, including delayed ones.
    pub fn from_pc(&mut self, datagram: &[u8]) -> Vec<Vec<u8>> {
        pass(&mut self.from_pc, datagram)
    }

    /// Returns the fault counters.
    #[must_use]
    pub fn counts(&self) -> NetworkCounts {
        NetworkCounts {
            to_pc: self.to_pc.counts(),
            from_pc: self.from_pc.counts(),
        }
    }
}

fn pass(line: &mut FaultyLink, datagram: &[u8]) -> Vec<Vec<u8>> {
    line.push(datagram);
    std::iter::from_fn(|| line.pop()).collect()
}

/// Returns the first rate that is not a probability.
#[must_use]
pub fn impossible(rates: &NetworkRates) -> Option<f64> {
    [rates.to_pc, rates.from_pc]
        .iter()
        .flat_map(|rates| {
            [
                rates.lost,
                rates.late,
                rates.duplicated,
                rates.reordered,
                rates.truncated,
                rates.corrupted,
            ]
        })
        .find(|rate| !(0.0..=1.0).contains(rate))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_direction_has_its_own_faults() {
        let mut network = Network::new(7);
        let lost = FaultRates {
            lost: 1.0,
            ..FaultRates::NONE
        };
        network.set(NetworkRates {
            to_pc: lost,
            from_pc: FaultRates::NONE,
        });
        assert!(network.to_pc(&[1]).is_empty());
        assert_eq!(network.from_pc(&[2]), [vec![2]]);
        let counts = network.counts();
        assert_eq!((counts.to_pc.lost, counts.from_pc.passed), (1, 1));
        network.set(NetworkRates::default());
        assert!(network.is_clear());
    }

    #[test]
    fn an_invalid_probability_is_found() {
        let mut rates = NetworkRates::default();
        assert_eq!(impossible(&rates), None);
        rates.from_pc.corrupted = 1.5;
        assert_eq!(impossible(&rates), Some(1.5));
    }
}
