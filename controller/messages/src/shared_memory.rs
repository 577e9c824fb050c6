//! What `/dev/shm` offers, and the reservation of what is taken from it.
//!
//! A page of a file in shared memory is taken when it is first touched, and where none is left whoever
//! touches it is ended by SIGBUS. iceoryx2 0.9.3 sizes its files with `ftruncate`, which reserves nothing, and touches them
//! at once; so this crate brings its own `ftruncate`, which reserves. What does not fit is then an error of
//! whatever was being created, at the start and in motion alike.

use core::ffi::c_int;
use core::sync::atomic::{AtomicU64, Ordering};
use std::fs;
use std::os::fd::{AsRawFd, BorrowedFd};

use rustix::fs::{Access, FallocateFlags, access, fallocate, fstat, statfs};
use rustix::io::{Errno, retry_on_intr};
use thiserror::Error;

/// Where shared memory lies.
pub(crate) const FOLDER: &str = "/dev/shm";

/// Least free shared memory needed to open an instance \[bytes\]: what all of its services take,
/// and room for the connections of observers.
pub const SHARED_MEMORY_MIN_BYTES: u64 = 4 << 20;

/// Least number of files that can still be created in it.
const FILES_MIN: u64 = 64;

/// The type of a tmpfs, see statfs(2).
const TMPFS: u64 = 0x0102_1994;

/// Why shared memory cannot be used.
#[derive(Debug, Error)]
pub enum SharedMemoryFault {
    /// There is none.
    #[error("{FOLDER} is missing: `mount -t tmpfs -o mode=1777 tmpfs {FOLDER}`")]
    Missing,
    /// It is no memory: its pages may wait for a disk.
    #[error("{FOLDER} is not a tmpfs (type {0:#x}): `mount -t tmpfs -o mode=1777 tmpfs {FOLDER}`")]
    NotTmpfs(u64),
    /// No file can be created in it.
    #[error(
        "{FOLDER} is not writable by this user ({0}): `mount -o remount,rw,mode=1777 {FOLDER}`"
    )]
    NotWritable(Errno),
    /// There is not enough of it.
    #[error(
        "{FOLDER} has {free} bytes free, at least {SHARED_MEMORY_MIN_BYTES} are needed: remove what fills it \
         (`controller clean` removes what killed processes left), or `mount -o remount,size=64M {FOLDER}`"
    )]
    Full {
        /// What is free \[bytes\].
        free: u64,
    },
    /// It holds as many files as it can.
    #[error(
        "{FOLDER} has room for {free} files, at least {FILES_MIN} are needed: remove some, or \
         `mount -o remount,nr_inodes=1k {FOLDER}`"
    )]
    TooManyFiles {
        /// How many can still be created.
        free: u64,
    },
    /// The system does not say what it is.
    #[error("{FOLDER} cannot be looked at: {0}")]
    Unknown(Errno),
}

/// Free shared memory \[bytes\], `u64::MAX` where it has no limit of its own.
///
/// # Errors
/// Where an instance could not be opened with it.
pub fn free_shared_memory_bytes() -> Result<u64, SharedMemoryFault> {
    let system = statfs(FOLDER).map_err(|error| match error {
        Errno::NOENT | Errno::NOTDIR => SharedMemoryFault::Missing,
        other => SharedMemoryFault::Unknown(other),
    })?;
    let kind = system.f_type as u64;
    if kind != TMPFS {
        return Err(SharedMemoryFault::NotTmpfs(kind));
    }
    access(FOLDER, Access::WRITE_OK | Access::EXEC_OK).map_err(SharedMemoryFault::NotWritable)?;
    // A tmpfs without a limit counts nothing.
    if system.f_files > 0 && system.f_ffree < FILES_MIN {
        return Err(SharedMemoryFault::TooManyFiles { free: system.f_ffree });
    }
    let free = match system.f_blocks {
        0 => u64::MAX,
        _ => system.f_bavail.saturating_mul(u64::try_from(system.f_bsize).unwrap_or(0)),
    };
    if free < SHARED_MEMORY_MIN_BYTES {
        return Err(SharedMemoryFault::Full { free });
    }
    Ok(free)
}

/// How often a file of this process could not be reserved, since it was started.
static REFUSED: AtomicU64 = AtomicU64::new(0);

/// How often a file of this process could not be reserved, since it was started.
pub(crate) fn refused_reservations() -> u64 {
    REFUSED.load(Ordering::Relaxed)
}

#[expect(unsafe_code, reason = "the C library's, and declared as it is there")]
unsafe extern "C" {
    fn __errno_location() -> *mut c_int;
}

/// Sizes a file and reserves what it takes, in place of the C library's function of this name: the linker
/// takes this one for every crate of the program, iceoryx2 above all.
///
/// Like that, it gives 0, or −1 and `errno`. A file that is new and does not fit is removed: iceoryx2 would
/// leave it without a size, and wait for it for ever. Where the file system cannot reserve, it is sized only.
#[expect(unsafe_code, reason = "the symbol and `errno` belong to the C library")]
// SAFETY: same signature and same meaning as in ftruncate(2), for 64-bit Linux.
#[unsafe(no_mangle)]
extern "C" fn ftruncate(file: c_int, length: i64) -> c_int {
    // SAFETY: the caller of ftruncate(2) owns the descriptor during the call; −1 is none.
    let result = match (file, u64::try_from(length)) {
        (0.., Ok(length)) => size(unsafe { BorrowedFd::borrow_raw(file) }, length),
        (_, Ok(_)) => Err(Errno::BADF),
        _ => Err(Errno::INVAL),
    };
    match result {
        Ok(()) => 0,
        Err(error) => {
            // SAFETY: the C library's pointer to this thread's own `errno`.
            unsafe { *__errno_location() = error.raw_os_error() };
            -1
        }
    }
}

/// Sizes and reserves; a file that is new and for which there is no room is removed.
fn size(file: BorrowedFd<'_>, length: u64) -> Result<(), Errno> {
    let before = u64::try_from(fstat(file)?.st_size).unwrap_or(0);
    if length > before {
        let reserve = || fallocate(file, FallocateFlags::empty(), before, length - before);
        if let Err(error @ (Errno::NOSPC | Errno::DQUOT | Errno::NOMEM)) = retry_on_intr(reserve) {
            REFUSED.fetch_add(1, Ordering::Relaxed);
            if before == 0 {
                remove(file);
            }
            return Err(error);
        }
    }
    rustix::fs::ftruncate(file, length)
}

/// Removes the name of an open file. One that has none any more stays as it is.
fn remove(file: BorrowedFd<'_>) {
    let link = format!("/proc/self/fd/{}", file.as_raw_fd());
    if let Ok(path) = fs::read_link(link) {
        // Gone already: as wanted.
        let _ = fs::remove_file(path);
    }
}
