//! The service's levels under load, at length: `cargo bench --bench service`.
//!
//! Throughput beside that of the same kernels without a service, and the time that health and
//! refusals take while ten times what can be served is asked for.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a measurement that cannot go on has failed")]
#![allow(clippy::print_stdout, reason = "the figures are what this is for")]
#![allow(dead_code, unreachable_pub, reason = "it shares what the tests have")]

#[path = "../tests/service/client.rs"]
mod client;
#[path = "../tests/service/pictures.rs"]
mod pictures;
#[path = "../tests/load/saturation.rs"]
mod saturation;
#[path = "../tests/service/server.rs"]
mod server;

use saturation::{kernel_rate, overload, service_rate, start};
use std::time::Duration;

const PERIOD: Duration = Duration::from_secs(20);

fn main() {
    let server = start();
    service_rate(&server, Duration::from_secs(2));
    let (before, service) = (kernel_rate(PERIOD / 2), service_rate(&server, PERIOD));
    let kernels = before.midpoint(kernel_rate(PERIOD / 2));
    println!("kernels alone     {kernels:8.2} pictures/s");
    println!("service           {service:8.2} pictures/s, {:.1} %", 100.0 * service / kernels);
    let level = overload(&server, service, PERIOD);
    println!("offered           {:8.2} requests/s", level.offered);
    println!("served            {:8.2} pictures/s", level.served);
    println!("health      p99   {:8.2?}", level.health);
    println!("metrics     p99   {:8.2?}", level.metrics);
    println!("refusals    p99   {:8.2?}", level.refusal);
    println!("shed (503)  p99   {:8.2?}", level.shed);
}
