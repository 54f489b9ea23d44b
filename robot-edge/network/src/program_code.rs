//! The program's own code in memory.

/// Reads the program's code and constants into memory. What runs for the first time after hours, as after the loss of a link, does not wait
/// for a slow disk then (madvise(2), `MADV_POPULATE_READ`). Where the system cannot do that, they are read when they are needed.
pub fn load_program() {
    #[cfg(target_os = "linux")]
    if let Err(why) = linux::load_program() {
        tracing::debug!(%why, "the program is read from disk as it runs");
    }
}

#[cfg(target_os = "linux")]
mod linux {
    use std::{fs, io};

    use rustix::mm::{Advice, madvise};

    pub(super) fn load_program() -> io::Result<()> {
        let program = fs::read_link("/proc/self/exe")?;
        let maps = fs::read_to_string("/proc/self/maps")?;
        let of_program = maps.lines().filter_map(|line| {
            // proc_pid_maps(5)
            let (range, _) = line.split_once(' ')?;
            let (from, to) = range.split_once('-')?;
            let [from, to] = [from, to].map(|place| usize::from_str_radix(place, 16).ok());
            let is_of_program = line.ends_with(program.to_str()?);
            from.zip(to).filter(|_| is_of_program)
        });
        for (from, to) in of_program {
            let start = std::ptr::with_exposed_provenance_mut(from);
            #[expect(unsafe_code, reason = "madvise takes an address")]
            // SAFETY: pages that are there stay as they are, and others are read from the file, as by their first use.
            unsafe {
                madvise(start, to - from, Advice::LinuxPopulateRead)?;
            }
        }
        Ok(())
    }
}
