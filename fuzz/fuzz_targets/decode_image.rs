#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pixmesh_fuzz::decode_image::run(bytes));
