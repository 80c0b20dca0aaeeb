//! The levels that the service keeps, in short; `cargo bench --bench service` measures at length.

use crate::saturation::{Overload, kernel_rate, overload, service_rate, start};
use std::time::Duration;

/// Measurements, of which one must reach the level: what else the machine does disturbs them.
const ATTEMPTS: usize = 5;
const PERIOD: Duration = Duration::from_secs(3);

/// The part of the kernels' own rate that the service reaches in this short form, with an unoptimised
/// build and beside whatever else the machine does; `cargo bench --bench service` shows nine tenths.
const LEAST_PART: f64 = 0.5;

/// How many times the capacity must have been asked for: nearly ten, since the clients run on the same
/// processors.
const LEAST_OVERLOAD: f64 = 8.0;

#[test]
fn the_service_meshes_most_of_what_its_kernels_do_alone() {
    let _alone = crate::alone();
    let server = start();
    service_rate(&server, PERIOD / 3);
    let mut seen = Vec::new();
    let reached = (0..ATTEMPTS).any(|_| {
        // Before and after, so that a machine that grows busier or idler is not mistaken for it.
        let before = kernel_rate(PERIOD / 2);
        let service = service_rate(&server, PERIOD);
        let after = kernel_rate(PERIOD / 2);
        seen.push((service, before, after));
        service >= LEAST_PART * before.midpoint(after)
    });
    println!("service, kernels before and after, per second: {seen:?}");
    assert!(reached, "{seen:?}");
}

#[test]
fn health_and_refusals_are_quick_while_ten_times_too_much_is_asked_for() {
    let _alone = crate::alone();
    let server = start();
    let capacity = service_rate(&server, PERIOD / 3);
    let mut seen: Vec<Overload> = Vec::new();
    let reached = (0..ATTEMPTS).any(|_| {
        let level = overload(&server, capacity, PERIOD);
        let quick = [level.refusal, level.shed].iter().all(|p99| *p99 < Duration::from_millis(20));
        let healthy =
            [level.health, level.metrics].iter().all(|p99| *p99 < Duration::from_millis(50));
        let steady = level.served >= 0.75 * capacity;
        let is_tenfold = level.offered >= LEAST_OVERLOAD * capacity;
        seen.push(level);
        quick && healthy && steady && is_tenfold
    });
    println!("capacity {capacity}: {seen:?}");
    assert!(reached, "capacity {capacity}: {seen:?}");
    server.wait_until_idle();
}
