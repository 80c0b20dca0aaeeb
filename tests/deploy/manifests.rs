//! The image's recipe, the manifests for Kubernetes, and the file for Compose.

use crate::server::program;
use crate::tools::{checkout, require, run, text};
use crate::{python_tool, read};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Kustomize components need a kubectl that Debian releases before 2025 do not have.
const KUBECTL: &str = "target/tools/usr/bin/kubectl";
const OVERLAYS: [&str; 2] = ["single", "cluster"];
/// Kinds that Kubernetes itself does not know: of the Prometheus operator and of KEDA.
const CUSTOM: [&str; 3] = ["PrometheusRule", "ScaledObject", "ServiceMonitor"];

/// The resources of an overlay, each as the text of one document.
fn resources(overlay: &str) -> Vec<String> {
    let folder = checkout("deploy/kubernetes/overlays").join(overlay);
    require(KUBECTL);
    let rendered = run(Command::new(checkout(KUBECTL)).arg("kustomize").arg(folder));
    rendered.split("\n---\n").map(str::to_owned).collect()
}

fn kind(resource: &str) -> &str {
    resource.lines().find_map(|line| line.strip_prefix("kind: ")).unwrap()
}

/// Checks resources against the schemas of Kubernetes; every property must be known.
fn validate(name: &str, resources: &[String]) -> Result<(), String> {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("manifests-{name}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let write = |(number, resource): (usize, &String)| {
        let path = folder.join(format!("{number}-{}.yaml", kind(resource)));
        std::fs::write(&path, resource).unwrap();
        path
    };
    let files: Vec<PathBuf> = resources.iter().enumerate().map(write).collect();
    let program = checkout(&python_tool("kubernetes-validate"));
    let output = Command::new(program).arg("--strict").args(&files).output().unwrap();
    let said = text(&output);
    let unknown = said.contains("Couldn't find schema");
    if output.status.success() && !unknown { Ok(()) } else { Err(said) }
}

#[test]
fn the_manifests_are_valid() {
    require(&python_tool("kubernetes-validate"));
    for overlay in OVERLAYS {
        let resources = resources(overlay);
        let (custom, known): (Vec<_>, Vec<_>) =
            resources.into_iter().partition(|resource| CUSTOM.contains(&kind(resource)));
        assert!(
            known.len() >= 6 && custom.len() >= 2,
            "{overlay}: {} {}",
            known.len(),
            custom.len()
        );
        validate(overlay, &known).unwrap_or_else(|said| panic!("{overlay}: {said}"));
    }
}

#[test]
fn the_manifests_in_the_document_on_scaling_are_valid() {
    require(&python_tool("kubernetes-validate"));
    let document = read("docs/scaling.md");
    let blocks = document.split("```yaml\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    let (manifests, others): (Vec<_>, Vec<_>) =
        blocks.map(str::to_owned).partition(|block| block.contains("\nkind: "));
    let (custom, known): (Vec<_>, Vec<_>) =
        manifests.into_iter().partition(|block| CUSTOM.contains(&kind(block)));
    assert_eq!((known.len(), custom.len(), others.len()), (1, 1, 1));
    validate("scaling", &known).unwrap_or_else(|said| panic!("{said}"));
    // Of what Kubernetes itself does not know: that it can be read.
    for block in custom.iter().chain(&others) {
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("scaling.yaml");
        std::fs::write(&path, block).unwrap();
        let script = "import sys, yaml; assert yaml.safe_load(open(sys.argv[1]))";
        run(Command::new(checkout(&python_tool("python"))).args(["-c", script]).arg(path));
    }
}

#[test]
fn a_mistake_in_a_manifest_is_found() {
    require(&python_tool("kubernetes-validate"));
    let resources = resources("single");
    let deployment = resources.iter().find(|resource| kind(resource) == "Deployment").unwrap();
    let wrong = deployment.replace("readOnlyRootFilesystem", "readOnlyRootFileSystem");
    assert!(wrong != *deployment);
    assert!(validate("wrong", &[wrong]).unwrap_err().contains("readOnlyRootFileSystem"));
}

#[test]
fn pods_have_no_rights_and_their_image_is_of_this_version() {
    let image = format!("image: pixmesh:{}", env!("CARGO_PKG_VERSION"));
    for overlay in OVERLAYS {
        let resources = resources(overlay);
        for resource in resources.iter().filter(|resource| kind(resource) == "Deployment") {
            for line in [
                "runAsNonRoot: true",
                "readOnlyRootFilesystem: true",
                "allowPrivilegeEscalation: false",
                "automountServiceAccountToken: false",
                "type: RuntimeDefault",
                "livenessProbe:",
                "memory:",
            ] {
                assert!(resource.contains(line), "{overlay}: {line} is missing: {resource}");
            }
            assert!(resource.contains(&image), "{overlay}: {resource}");
        }
    }
}

#[test]
fn jobs_are_on_a_volume_that_outlives_the_pod_where_one_process_keeps_them() {
    let resources = resources("single");
    let deployment = resources.iter().find(|resource| kind(resource) == "Deployment").unwrap();
    assert!(deployment.contains("claimName: pixmesh-data"), "{deployment}");
    assert!(!deployment.contains("emptyDir"), "{deployment}");
    assert!(deployment.contains("type: Recreate"), "{deployment}");
    assert!(resources.iter().any(|resource| kind(resource) == "PersistentVolumeClaim"));
}

#[test]
fn the_service_has_the_settings_that_the_single_form_gives_it() {
    let help = run(program().args(["serve", "--help"]));
    let manifest = read("deploy/kubernetes/base/deployment.yaml");
    let line = manifest.lines().find(|line| line.trim().starts_with("args: [serve")).unwrap();
    let flags = line.split(['[', ',', ']']).filter_map(|word| word.trim().strip_prefix("--"));
    let flags: Vec<_> = flags.map(|flag| flag.split('=').next().unwrap()).collect();
    assert_eq!(flags.len(), 2);
    for flag in flags {
        assert!(help.contains(&format!("--{flag} ")), "there is no --{flag}");
    }
}

#[test]
fn compose_can_read_its_file() {
    require(&python_tool("check-jsonschema"));
    let compose = checkout("deploy/compose.yaml");
    let mut check = Command::new(checkout(&python_tool("check-jsonschema")));
    run(check.args(["--builtin-schema", "vendor.compose-spec"]).arg(&compose));
    // Each file that it mounts is there.
    for line in read("deploy/compose.yaml").lines() {
        let Some(mounted) = line.trim().strip_prefix("- ./") else { continue };
        let path = Path::new("deploy").join(mounted.split(':').next().unwrap());
        assert!(checkout(path.to_str().unwrap()).exists(), "{} is missing", path.display());
    }
}

#[test]
fn the_recipe_of_the_image_is_good() {
    require(&python_tool("hadolint"));
    run(Command::new(checkout(&python_tool("hadolint"))).arg(checkout("Dockerfile")));
}

#[test]
fn shellcheck_finds_nothing_in_the_scripts() {
    require("shellcheck");
    let scripts = ["deploy/container/verify", "test", "examples/mesh.sh", "examples/job.sh"];
    run(Command::new("shellcheck").args(scripts.map(checkout)));
}
