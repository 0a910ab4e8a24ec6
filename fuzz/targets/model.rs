//! Bytes as model files: read, or refused with a message, and what was read is read again from what
//! it writes.
#![no_main]

use libfuzzer_sys::fuzz_target;
use pinc_net::PincNet;

fuzz_target!(|bytes: &[u8]| {
    match PincNet::from_bytes(bytes) {
        Ok(net) => {
            let written = net.to_bytes();
            let again = PincNet::from_bytes(&written).expect("what is written can be read");
            assert_eq!(again.to_bytes(), written);
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
