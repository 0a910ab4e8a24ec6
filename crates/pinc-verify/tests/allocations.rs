//! An estimate of a net's error allocates nothing.
#![expect(unsafe_code, reason = "an allocator that counts must implement an unsafe trait")]

use pinc_expr::PlantEquations;
use pinc_net::{Ansatz, Domain, NetConfig, PincNet};
use pinc_plants::VanDerPol;
use pinc_verify::ErrorEstimate;
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator, with a count of all threads' requests.
struct Counting;

static REQUESTS: AtomicUsize = AtomicUsize::new(0);

fn count() {
    REQUESTS.fetch_add(1, Ordering::Relaxed);
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: `memory` came from `System` with this layout.
        unsafe { System.dealloc(memory, layout) }
    }
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: `memory` came from `System` with this layout.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn an_estimate_allocates_nothing() {
    let plant = PlantEquations::traced(VanDerPol::default()).to_dyn().unwrap();
    let domain = Domain::new([-2.0..=2.0, -3.0..=3.0], [-1.0..=1.0]);
    for ansatz in [Ansatz::HardLinear, Ansatz::Direct] {
        let config = NetConfig { ansatz, ..NetConfig::new(0.3, 2, 6) };
        let net = PincNet::new(&*plant, &config, &domain, 3).unwrap();
        let mut estimate = ErrorEstimate::new(&net, &*plant).unwrap();
        let mut error = [0.0; 2];
        let before = REQUESTS.load(Ordering::Relaxed);
        estimate.write(&[1.0, 0.5], &[0.2], &[], &mut error);
        assert_eq!(REQUESTS.load(Ordering::Relaxed), before, "{ansatz:?}");
        assert!(error.iter().all(|error| error.abs() > 0.0));
    }
}
