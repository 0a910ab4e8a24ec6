//! No model allocates after its construction.

use crate::candidates::candidates;
use crate::harness::{Outputs, Point, linearize, linearize_output};
use pinc_ode::Stages;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// Counts this thread's allocations, and hands them on to the system.
struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    ALLOCATIONS.with(|n| n.set(n.get() + 1));
}

#[expect(unsafe_code, reason = "a global allocator is an unsafe trait; this one only counts")]
// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// How many allocations `work` makes.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.with(Cell::get);
    work();
    ALLOCATIONS.with(Cell::get) - before
}

#[test]
fn allocations_are_counted() {
    let grow = || {
        let mut v = std::hint::black_box(vec![1_u8]);
        v.reserve_exact(1000);
        std::hint::black_box(&v);
    };
    assert_eq!(allocations(grow), 2);
    assert_eq!(allocations(|| ()), 0);
}

#[test]
fn nothing_is_allocated_after_construction() {
    for candidate in candidates() {
        let mut model = candidate.build();
        let point = candidate.middle();
        let several = Point::join(&vec![point.clone(); 5]);
        let mut one_result = linearize(&mut *model, &point);
        let mut results = linearize(&mut *model, &several);
        let mut outputs: Outputs = linearize_output(&mut *model, &several);
        let mut fresh = candidate.build();
        for model in [&mut model, &mut fresh] {
            let made = allocations(|| {
                for _ in 0..3 {
                    let Stages { x, u, p } = point.stages();
                    model.step(x, u, p, &mut one_result.next);
                    model.linearize(point.stages(), one_result.as_mut());
                    model.linearize(several.stages(), results.as_mut());
                    let width = model.dims().ny;
                    model.output(x, u, p, &mut outputs.y[..width]);
                    model.linearize_output(several.stages(), outputs.as_mut());
                }
            });
            assert_eq!(made, 0, "{}", candidate.name);
        }
    }
}
