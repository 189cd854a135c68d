//! Power lost at every step, with every kind of half-arrived write, and again while recovering.

use crate::{
    crash_disk::{Broken, CrashDisk},
    scenario::{self, Acknowledged, shots},
};
use captured::output::FileSystem;
use drivers::chance::Chance;
use std::sync::Arc;

/// How much was looked at, and the first thing that was wrong.
struct Seen {
    states: usize,
    violation: Option<String>,
}

/// Runs the scenario to every step, and looks at `each` states of the disk after it.
fn explore(broken: Option<Broken>, each: u64) -> Seen {
    let mut seen = Seen {
        states: 0,
        violation: None,
    };
    for steps in 0.. {
        let disk = Arc::new(CrashDisk::new(broken));
        disk.lose_power_after(steps);
        let mut told = Acknowledged::default();
        let shared: Arc<dyn FileSystem> = disk.clone();
        scenario::run(&shared, &shots(), &mut |said| told.hear(said));
        let finished = disk.steps() < steps;
        for seed in 0..each {
            let chance = Chance::new(steps as u64).of(seed);
            let mut asked = 0;
            let mut choose = || {
                asked += 1;
                (chance.unit(asked) * f64::from(u32::MAX)) as u32
            };
            let found = Arc::new(disk.after_power_loss(&mut choose));
            // One in four loses power once more while it recovers, or is killed there.
            let found = if seed.is_multiple_of(4) {
                found.lose_power_after(choose() as usize % 20);
                let shared: Arc<dyn FileSystem> = found.clone();
                let _ = captured::store::Store::on(shared, shots());
                Arc::new(if seed.is_multiple_of(8) {
                    found.after_power_loss(&mut choose)
                } else {
                    found.after_kill()
                })
            } else {
                found
            };
            seen.states += 1;
            let shared: Arc<dyn FileSystem> = found;
            if let Err(violation) = scenario::violations(&shared, &shots(), &told) {
                seen.violation
                    .get_or_insert(format!("step {steps}, state {seed}: {violation}"));
            }
        }
        if finished {
            return seen;
        }
    }
    unreachable!()
}

#[test]
fn no_loss_of_power_loses_or_tears_a_shot_that_was_acknowledged() {
    let seen = explore(None, 60);
    eprintln!(
        "figure | loss of power | {} crash states, 0 violations",
        seen.states
    );
    assert_eq!(seen.violation, None);
    assert!(seen.states > 3_000, "{} states", seen.states);
}

#[test]
#[ignore = "the long form"]
fn no_loss_of_power_loses_a_shot_in_a_hundred_thousand_states() {
    let seen = explore(None, 1600);
    eprintln!(
        "figure | loss of power (long) | {} crash states, 0 violations",
        seen.states
    );
    assert_eq!(seen.violation, None);
    assert!(seen.states >= 100_000, "{} states", seen.states);
}

#[test]
fn a_commit_that_leaves_out_one_step_is_caught() {
    for broken in [
        Broken::FileSync,
        Broken::FolderSync,
        Broken::ParentSync,
        Broken::Rename,
    ] {
        let seen = explore(Some(broken), 60);
        assert!(seen.violation.is_some(), "{broken:?} was not noticed");
    }
    eprintln!("figure | commits with one step left out | 4 of 4 caught");
}
