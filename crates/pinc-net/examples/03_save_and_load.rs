//! A net as the bytes of a model file and back: it stands alone, with its names, its domain and its
//! T.
//!
//! `cargo run --release -p pinc-net --example 03_save_and_load`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

#[path = "01_train.rs"]
#[expect(dead_code, reason = "its `main` is not needed")]
mod train;

use pinc_net::PincNet;
use std::error::Error;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let net = train::trained()?.net;
    // The library opens no files: `std::fs::write` and `std::fs::read` are the caller's.
    let bytes = net.to_bytes();
    let read = PincNet::from_bytes(&bytes)?;
    println!(
        "{} bytes, a net of {:?} under {:?}",
        bytes.len(),
        read.state_names(),
        read.input_names()
    );
    println!("for steps of {} s, trained on {:?}", read.sample_time_s(), read.domain());
    assert_eq!(read, net);
    // How far a point is outside the box, one number per state and input; 0 inside.
    let outside: Vec<_> = read.domain().excess(&[3.5, 0.0], &[0.0], &[]).collect();
    println!("x1 = 3.5 is outside by {outside:?}");

    // A damaged file is refused.
    let error = PincNet::from_bytes(&bytes[..bytes.len() - 8]).err().ok_or("half a file")?;
    println!("cut off: {error}");
    Ok(())
}
