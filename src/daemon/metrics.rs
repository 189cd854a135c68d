//! What happened so far, as Prometheus reads it.

use super::State;
use crate::api::Phase;
use prometheus_client::{
    encoding::{EncodeLabelSet, text::encode},
    metrics::{counter::Counter, family::Family, gauge::Gauge, histogram::Histogram},
    registry::{Registry, Unit},
};
use std::sync::atomic::{AtomicI64, AtomicU64};

/// Upper bounds of the classes of shot times.
const SECONDS: [f64; 10] = [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 25.6, 51.2];

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct DevicePhase {
    device: String,
    phase: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct OfDevice {
    device: String,
}

/// Counters and the way to write them down.
pub(super) struct Metrics {
    registry: Registry,
    /// Shots committed.
    pub shots: Counter,
    /// Shots that failed.
    pub failures: Counter,
    /// From the request to the acknowledgement.
    pub shot_seconds: Histogram,
    /// Views answered.
    pub views: Counter,
    /// Connections that are open.
    pub connections: Gauge<i64, AtomicI64>,
    used: Gauge<u64, AtomicU64>,
    resident: Gauge<u64, AtomicU64>,
    phases: Family<DevicePhase, Gauge>,
    reconnects: Family<OfDevice, Gauge<u64, AtomicU64>>,
    previews: Family<OfDevice, Gauge<u64, AtomicU64>>,
}

impl Metrics {
    pub fn new() -> Self {
        let mut metrics = Self {
            registry: Registry::with_prefix("captured"),
            shots: Counter::default(),
            failures: Counter::default(),
            shot_seconds: Histogram::new(SECONDS),
            views: Counter::default(),
            connections: Gauge::default(),
            used: Gauge::default(),
            resident: Gauge::default(),
            phases: Family::default(),
            reconnects: Family::default(),
            previews: Family::default(),
        };
        let registry = &mut metrics.registry;
        registry.register("shots", "Shots committed", metrics.shots.clone());
        registry.register(
            "shot_failures",
            "Shots that failed",
            metrics.failures.clone(),
        );
        registry.register_with_unit(
            "shot_duration",
            "From the request to the acknowledgement",
            Unit::Seconds,
            metrics.shot_seconds.clone(),
        );
        registry.register("views", "Views of kept shots", metrics.views.clone());
        registry.register(
            "connections",
            "Open connections",
            metrics.connections.clone(),
        );
        let (used, resident) = (metrics.used.clone(), metrics.resident.clone());
        registry.register_with_unit("store", "All shots", Unit::Bytes, used);
        registry.register_with_unit("resident_memory", "The process", Unit::Bytes, resident);
        let help = "1 for what a device is doing";
        registry.register("device_phase", help, metrics.phases.clone());
        let help = "How often a device was opened again";
        registry.register("device_reconnects", help, metrics.reconnects.clone());
        registry.register(
            "device_previews",
            "Previews so far",
            metrics.previews.clone(),
        );
        metrics
    }

    /// All of it, in OpenMetrics' text form.
    pub fn text(&self, daemon: &State) -> String {
        self.used.set(daemon.store.used_bytes());
        self.resident.set(resident_bytes());
        for (status, previews) in daemon.devices.statuses() {
            let device = status.device.address;
            for phase in Phase::ALL {
                let labels = DevicePhase {
                    device: device.clone(),
                    phase: phase.name().to_owned(),
                };
                self.phases
                    .get_or_create(&labels)
                    .set(i64::from(phase == status.phase));
            }
            let of = OfDevice { device };
            self.reconnects.get_or_create(&of).set(status.reconnects);
            self.previews.get_or_create(&of).set(previews);
        }
        let mut text = String::new();
        // Writing into a string cannot fail.
        let _ = encode(&mut text, &self.registry);
        text
    }
}

/// Resident memory of this process; 0 where the system does not say.
fn resident_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kibibytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok());
    kibibytes.unwrap_or(0) << 10
}
