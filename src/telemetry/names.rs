//! Every metric: its name, kind, labels and meaning, declared once.
//!
//! What is written out, the dashboard and the alerts all take the names from here.

use pixmesh_engine::declare_metrics;
use pixmesh_engine::telemetry::Metric;

declare_metrics! {
    HTTP_REQUESTS: Counter "pixmesh_http_requests_total" ["route", "method", "code"]
        "Responses, by route, method and status";
    HTTP_DURATION: Histogram "pixmesh_http_request_duration_seconds" ["route"]
        "Seconds from the end of a request's header to the start of its response";
    REQUESTS_IN_PROGRESS: Gauge "pixmesh_requests_in_progress" []
        "Requests without a response yet: uploading, queued or running";
    CONNECTIONS: Gauge "pixmesh_open_connections" [] "Open connections of the public listener";
    CONNECTIONS_REFUSED: Counter "pixmesh_connections_refused_total" ["reason"]
        "Connections refused, by the limit that was reached: 'total', or 'address' for one client address";
    EVENT_STREAMS: Gauge "pixmesh_event_streams" [] "Open streams of job events";
    WORKERS: Gauge "pixmesh_workers" [] "Worker threads: the most tasks that run at the same time";
    PANICS: Counter "pixmesh_panics_total" [] "Panics of the service; each is a defect to report";
    DECODER_PANICS: Counter "pixmesh_decoder_panics_total" []
        "Panics of picture decoders, caused by uploaded files; the response is 422";
    LOG_LINES_DROPPED: Counter "pixmesh_log_lines_dropped_total" []
        "Log lines dropped because standard error was not read";
    PROCESS_RESIDENT: Gauge "process_resident_memory_bytes" []
        "Resident memory of the process in bytes";
    PROCESS_CPU: Counter "process_cpu_seconds_total" [] "CPU seconds of all threads";
    PROCESS_FDS: Gauge "process_open_fds" [] "Open file descriptors";
    PROCESS_MAX_FDS: Gauge "process_max_fds" [] "Limit of open file descriptors";
    PROCESS_START: Gauge "process_start_time_seconds" []
        "Start time of the process, in seconds since 1970";
    BUILD_INFO: Gauge "pixmesh_build_info" ["version", "commit"]
        "1, with the version and commit of the build as labels";
}

/// Every metric of the service and the crates that it is made of.
pub fn all() -> impl Iterator<Item = &'static Metric> {
    METRICS.iter().chain(pixmesh_engine::telemetry::METRICS).chain(pixmesh_jobs::telemetry::METRICS)
}
