//! Tells the linker to hand METIS's two calls about signals to `linalg/sparse/ordering.rs`.
//!
//! While it works, METIS answers SIGTERM with a jump back into itself, whichever
//! thread the signal meets: a process that is asked to end then crashes. Only with the
//! feature `python`, whose extension module shares its process with handlers of others.

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
