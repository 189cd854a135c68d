//! Memory in pages of 2 MiB, where the kernel leaves that to the program.

use std::{env, fs, os::unix::process::CommandExt, process::Command};

/// Where the kernel says who decides.
const WHO_DECIDES: &str = "/sys/kernel/mm/transparent_hugepage/enabled";
/// What the C library's allocator reads at its start, and at no other time (glibc 2.35 or newer).
const TUNABLES: &str = "GLIBC_TUNABLES";
const ASK: &str = "glibc.malloc.hugetlb=1";

/// Starts this program anew, as the same process, with an allocator that asks for huge pages. Returns where that
/// is settled already, or cannot be.
///
/// Planes of megabytes come and go with every stage and light, and a page of 4 KiB at a time the kernel spends a
/// fifth of a shot on handing them out: with huge ones a shot of 512 × 512 took 213 ms instead of 298 in the same
/// minute, one of 12 megapixels 3.5 s instead of 3.7, each with as much memory as before.
pub fn with_huge_pages() {
    let decides = fs::read_to_string(WHO_DECIDES).unwrap_or_default();
    if !is_ours_to_ask(&decides, env::var_os(TUNABLES).is_some()) {
        return;
    }
    let mut words = env::args_os();
    let name = words.next().unwrap_or_default();
    let mut again = Command::new("/proc/self/exe");
    // It returns only where it failed, and then all goes on in small pages.
    let _ = again.arg0(name).args(words).env(TUNABLES, ASK).exec();
}

/// `decides` is what the kernel says, the choice made in brackets.
fn is_ours_to_ask(decides: &str, asked: bool) -> bool {
    cfg!(all(target_os = "linux", target_env = "gnu")) && decides.contains("[madvise]") && !asked
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn huge_pages_are_asked_for_once_and_where_the_kernel_leaves_it_to_programs() {
        let ours = "always [madvise] never\n";
        assert!(is_ours_to_ask(ours, false));
        assert!(!is_ours_to_ask(ours, true));
        for settled in ["[always] madvise never\n", "always madvise [never]\n", ""] {
            assert!(!is_ours_to_ask(settled, false), "{settled}");
        }
    }
}
