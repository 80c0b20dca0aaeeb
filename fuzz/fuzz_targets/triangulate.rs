#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pixmesh_fuzz::triangulate::run(bytes));
