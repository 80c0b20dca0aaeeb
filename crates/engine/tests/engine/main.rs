//! Whole runs of the engine.

mod same_bytes;
mod sprites;
