//! The free memory of the machine, which bounds what a scene may decode.

use std::fs;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes that images need which are being decoded now. What is decoded is no longer free.
static RESERVED: AtomicU64 = AtomicU64::new(0);

/// Memory for something that is about to be allocated, until it is dropped.
#[derive(Debug)]
pub struct Reservation(u64);

impl Reservation {
    /// Reserves bytes of the free memory.
    ///
    /// # Errors
    /// Too little free memory is an error with both sizes.
    pub fn new(bytes: u64) -> Result<Self, String> {
        Self::within(bytes, free())
    }

    fn within(bytes: u64, free: Option<u64>) -> Result<Self, String> {
        let this = Self(bytes);
        let all = RESERVED.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
        match free.filter(|&free| all > free) {
            None => Ok(this),
            Some(free) => {
                Err(format!("needs {} MiB of memory, and {} MiB are free", mebibytes(bytes), mebibytes(free)))
            }
        }
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        RESERVED.fetch_sub(self.0, Ordering::Relaxed);
    }
}

/// Returns bytes in mebibytes, rounded up.
pub fn mebibytes(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}

/// Returns the bytes of memory that are free, of the machine, of this process' control group and of its address space
/// (`ulimit -v`), where the system says so.
pub fn free() -> Option<u64> {
    let of_machine = fs::read_to_string("/proc/meminfo").ok().and_then(|text| of_meminfo(&text));
    of_machine.into_iter().chain(of_group()).chain(of_process()).min()
}

fn of_meminfo(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? << 10)
}

/// Returns the free bytes of the control group (version 2): of jobs on clusters, and of containers.
fn of_group() -> Option<u64> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    let folder = format!("/sys/fs/cgroup{}", groups.lines().find_map(|line| line.strip_prefix("0::"))?);
    let read = |name: &str| fs::read_to_string(format!("{folder}/{name}")).ok();
    of_group_files(&read("memory.max")?, &read("memory.current")?, &read("memory.stat").unwrap_or_default())
}

/// Files that were read and may be dropped count as free.
fn of_group_files(max: &str, current: &str, stat: &str) -> Option<u64> {
    let number = |text: &str| text.trim().parse::<u64>().ok();
    let droppable = stat.lines().find_map(|line| line.strip_prefix("inactive_file ")).and_then(number).unwrap_or(0);
    Some((number(max)? + droppable).saturating_sub(number(current)?))
}

/// Returns the bytes that the address space may grow by.
fn of_process() -> Option<u64> {
    let read = |name: &str| fs::read_to_string(format!("/proc/self/{name}")).ok();
    of_process_files(&read("limits")?, &read("status")?)
}

fn of_process_files(limits: &str, status: &str) -> Option<u64> {
    let limit = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let soft = limit.split_whitespace().next()?.parse::<u64>().ok()?;
    let size = status.lines().find_map(|line| line.strip_prefix("VmSize:"))?.trim().strip_suffix("kB")?;
    Some(soft.saturating_sub(size.trim().parse::<u64>().ok()? << 10))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_reserved_is_no_longer_free() {
        let free = Some(100 << 20);
        let first = Reservation::within(60 << 20, free).unwrap();
        let refused = Reservation::within(60 << 20, free).unwrap_err();
        assert_eq!(refused, "needs 60 MiB of memory, and 100 MiB are free");
        let second = Reservation::within(30 << 20, free).unwrap();
        drop(first);
        assert!(Reservation::within(60 << 20, free).is_ok(), "a refused reservation is given back, too");
        assert!(Reservation::within(u64::MAX / 2, None).is_ok(), "unknown memory refuses nothing");
        drop(second);
    }

    #[test]
    fn free_memory_is_read() {
        assert_eq!(of_meminfo("MemTotal: 9 kB\nMemAvailable:    2048 kB\n"), Some(2 << 20));
        assert_eq!(of_meminfo("MemTotal: 9 kB\n"), None);
        assert_eq!(of_group_files("1000\n", "700\n", "anon 5\ninactive_file 200\n"), Some(500));
        assert_eq!(of_group_files("1000\n", "1200\n", ""), Some(0));
        assert_eq!(of_group_files("max\n", "1200\n", ""), None);
        let limits =
            |soft: &str| format!("Limit  Soft Limit\nMax address space      {soft}      unlimited      bytes\n");
        assert_eq!(of_process_files(&limits("3072"), "VmPeak: 9 kB\nVmSize:\t    2 kB\n"), Some(1024));
        assert_eq!(of_process_files(&limits("unlimited"), "VmSize: 2 kB\n"), None);
        assert!(free().is_none_or(|free| free > 1 << 20));
    }
}
