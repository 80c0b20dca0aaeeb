//! Every metric: its name, kind, labels and meaning, declared once.
//!
//! What is written out, the dashboard and the alerts all take the names from here.

use pixmesh_engine::declare_metrics;
use pixmesh_engine::telemetry::Metric;

declare_metrics! {
    HTTP_REQUESTS: Counter "pixmesh_http_requests_total" ["route", "method", "code"]
        "Requests answered, by route, method and status";
    HTTP_DURATION: Histogram "pixmesh_http_request_duration_seconds" ["route"]
        "Seconds from a request's header to its answer";
    REQUESTS_IN_PROGRESS: Gauge "pixmesh_requests_in_progress" []
        "Requests being received, waiting or worked on";
    CONNECTIONS: Gauge "pixmesh_open_connections" [] "Connections of the public listener that are open";
    CONNECTIONS_REFUSED: Counter "pixmesh_connections_refused_total" ["reason"]
        "Connections refused: 'total' are open, or 'address' has its part";
    EVENT_STREAMS: Gauge "pixmesh_event_streams" [] "Clients that follow the events of a job";
    WORKERS: Gauge "pixmesh_workers" [] "Meshes that can be made at the same time";
    PANICS: Counter "pixmesh_panics_total" [] "Panics, each a defect";
    DECODER_PANICS: Counter "pixmesh_decoder_panics_total" []
        "Uploaded files that made a decoder from another crate panic; answered with 422";
    LOG_LINES_DROPPED: Counter "pixmesh_log_lines_dropped_total" []
        "Lines of the log that were dropped because nobody read it";
    PROCESS_RESIDENT: Gauge "process_resident_memory_bytes" []
        "Resident memory of the process in bytes";
    PROCESS_CPU: Counter "process_cpu_seconds_total" [] "Seconds of processor time, of all threads";
    PROCESS_FDS: Gauge "process_open_fds" [] "Files and connections the process has open";
    PROCESS_MAX_FDS: Gauge "process_max_fds" [] "Files and connections the process may have open";
    PROCESS_START: Gauge "process_start_time_seconds" []
        "When the process started, in seconds since 1970";
    BUILD_INFO: Gauge "pixmesh_build_info" ["version", "commit"]
        "Version of the service, and the commit it was built from";
}

/// Every metric of the service and the crates that it is made of.
pub fn all() -> impl Iterator<Item = &'static Metric> {
    METRICS.iter().chain(pixmesh_engine::telemetry::METRICS).chain(pixmesh_jobs::telemetry::METRICS)
}
