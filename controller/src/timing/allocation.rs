//! Counts heap allocations of a thread, in every build.

use core::cell::Cell;
use std::alloc::{GlobalAlloc, Layout, System};

thread_local! {
    static COUNTED: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, which counts each thread's allocations.
#[derive(Debug)]
pub struct CountingAllocator;

fn count() {
    // A thread that ends has no counter any more, and nobody who would ask for it.
    let _ = COUNTED.try_with(|counted| counted.set(counted.get() + 1));
}

#[expect(unsafe_code, reason = "a global allocator is an unsafe trait; every call is forwarded")]
// SAFETY: every call is forwarded to the system's allocator unchanged; counting does not allocate,
// since the counter is a constant-initialised thread local without a destructor.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's contract is passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's contract is passed on.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller's contract is passed on.
        unsafe { System.realloc(pointer, layout, new_size) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's contract is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Allocations of the calling thread so far; 0 in a program with another allocator.
#[must_use]
pub fn counted() -> u64 {
    COUNTED.with(Cell::get)
}
