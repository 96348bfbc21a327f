//! Plugins in C, compiled by the system's compiler.

use crate::root;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Compiles sources to a library against the ABI's header.
///
/// # Panics
/// When they do not compile without a warning.
#[must_use]
pub fn compile(sources: &[&Path], options: &[&str], to: &Path) -> PathBuf {
    compile_with(&root().join("plugin-api/abi/include"), sources, options, to)
}

/// As [`compile`], against the header in a folder.
///
/// # Panics
/// When they do not compile without a warning.
#[must_use]
pub fn compile_with(header: &Path, sources: &[&Path], options: &[&str], to: &Path) -> PathBuf {
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let output = Command::new(compiler)
        .args([
            "-std=gnu11",
            "-O1",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-fPIC",
            "-shared",
        ])
        .arg("-fvisibility=hidden")
        .arg("-I")
        .arg(header)
        .arg("-I")
        .arg(root().join("sdk-template/c/common/src"))
        .args(sources)
        .arg("-o")
        .arg(to)
        .args(options)
        .args(["-lm", "-lpthread"])
        .output()
        .expect("a C compiler is installed");
    assert!(
        output.status.success(),
        "{sources:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    to.into()
}

fn place(folder: &Path, name: &str) -> PathBuf {
    use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
    folder.join(format!("{DLL_PREFIX}{name}{DLL_SUFFIX}"))
}

/// The plugin that is right but for the fault that a check is for; `none` has no fault.
#[must_use]
pub fn broken(folder: &Path, check: &str) -> PathBuf {
    let name = check.replace('-', "_");
    let fault = format!("-DFAULT=F_{name}");
    let source = root().join("tests/broken/broken.c");
    compile(&[&source], &[&fault], &place(folder, &name))
}

/// A plugin that needs a library which is not there.
///
/// # Panics
/// When there is no compiler.
#[must_use]
pub fn without_its_library(folder: &Path) -> PathBuf {
    let source = folder.join("other.c");
    std::fs::write(&source, "int other(void);\nint other(void) { return 1; }\n").expect("a file");
    let other = compile(
        &[&source],
        &["-fvisibility=default"],
        &place(folder, "vendor-sdk"),
    );
    let user = folder.join("user.c");
    std::fs::write(
        &user,
        "int other(void);\nint use_it(void);\nint use_it(void) { return other(); }\n",
    )
    .expect("a file");
    let search = format!("-L{}", folder.display());
    let sources = [root().join("tests/broken/broken.c"), user];
    let sources = sources.each_ref().map(PathBuf::as_path);
    let options = [search.as_str(), "-lvendor-sdk"];
    let made = compile(&sources, &options, &place(folder, "needs_another"));
    std::fs::remove_file(other).expect("the library");
    made
}
