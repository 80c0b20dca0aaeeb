//! The page's modules, checked by TypeScript against what the OpenAPI document says.

use crate::tools::{checkout, require, run};
use std::process::Command;

#[test]
fn the_modules_agree_with_the_openapi_document() {
    let programs = checkout("tests/studio/node_modules/.bin");
    require("tests/studio/node_modules/.bin/tsc");
    let mut generate = Command::new(programs.join("openapi-typescript"));
    run(generate
        .arg(checkout("openapi/openapi.json"))
        .arg("--output")
        .arg(checkout("studio/api.d.ts")));
    run(Command::new(programs.join("tsc")).arg("--project").arg(checkout("studio")));
}
