//! Links METIS's two calls about signals to `linalg/sparse/ordering.rs`.
//!
//! METIS reacts to SIGTERM with a jump into its own stack, in whichever thread gets the signal:
//! a process that is asked to end then crashes. This is done only with the feature `python`,
//! because an extension module shares its process with other signal handlers.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let elf = std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|os| os == "linux");
    let python = std::env::var_os("CARGO_FEATURE_PYTHON").is_some();
    if elf && python {
        for name in ["gk_sigtrap", "gk_siguntrap"] {
            println!("cargo:rustc-link-arg=-Wl,--wrap={name}");
        }
    }
}
