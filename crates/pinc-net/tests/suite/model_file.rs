//! The model file: round trip, stability, and every kind of damage.

use pinc_net::{Ansatz, Domain, ModelError, NetConfig, PincNet, Scenario};
use pinc_ode::{Dims, Plant};
use pinc_plants::{FourTanks, VanDerPol};
use proptest::prelude::*;

fn net<P: Plant>(plant: &P, ansatz: Ansatz, time_only: bool) -> PincNet {
    let dims = plant.dims();
    let domain = Domain {
        state_low: vec![0.5; dims.nx],
        state_high: vec![6.0; dims.nx],
        input_low: vec![-1.0; dims.nu],
        input_high: vec![3.0; dims.nu],
        parameters: Vec::new(),
    };
    let scenario = Scenario { initial_state: vec![1.5; dims.nx], input: vec![0.5; dims.nu] };
    let config = NetConfig {
        sample_time_s: 0.7,
        hidden_layers: 3,
        neurons: 6,
        ansatz,
        time_only: time_only.then_some(scenario),
    };
    PincNet::new(plant, &config, &domain, 11).unwrap()
}

#[test]
fn a_net_survives_the_file_bit_for_bit_and_the_bytes_are_stable() {
    for ansatz in [Ansatz::Direct, Ansatz::HardLinear] {
        for time_only in [false, true] {
            let net = net(&FourTanks::antonelo(), ansatz, time_only);
            let bytes = net.to_bytes();
            assert_eq!(PincNet::from_bytes(&bytes).unwrap(), net);
            assert_eq!(bytes, net.to_bytes());
        }
    }
}

/// The units of states and inputs stay with the net; a file may leave them out.
#[test]
fn a_net_keeps_the_units_of_its_plant() {
    let net = net(&FourTanks::antonelo(), Ansatz::Direct, false);
    let of = |name: &str| net.units.get(name).map(String::as_str);
    assert_eq!([of("h1"), of("u2"), of("x")], [Some("cm"), Some("V"), None]);
    let without = with_header(&net.to_bytes(), |header| {
        let (before, rest) = header.split_once(r#"\"units\":{"#).unwrap();
        before.trim_end_matches(',').to_owned() + &rest[rest.find('}').unwrap() + 1..]
    });
    let mut read = PincNet::from_bytes(&without).unwrap();
    assert!(read.units.is_empty());
    read.units.clone_from(&net.units);
    assert_eq!(read, net);
}

/// The file with its header's text changed; the header is filled up with spaces.
pub(crate) fn with_header(bytes: &[u8], change: impl Fn(&str) -> String) -> Vec<u8> {
    let length = usize::try_from(u64::from_le_bytes(bytes[..8].try_into().unwrap())).unwrap();
    let mut header = change(std::str::from_utf8(&bytes[8..8 + length]).unwrap()).into_bytes();
    header.resize(header.len().next_multiple_of(8), b' ');
    let mut result = (header.len() as u64).to_le_bytes().to_vec();
    result.extend(header);
    result.extend(&bytes[8 + length..]);
    result
}

#[test]
fn each_kind_of_damage_is_named() {
    let bytes = net(&VanDerPol::default(), Ansatz::Direct, false).to_bytes();
    let cases = [
        ("pinc-model", "other", "`format`"),
        (r#""version":"1""#, r#""version":"3""#, "`version`"),
        (r#"\"horizon_s\":0.7"#, r#"\"horizon_s\":-1"#, "horizon_s"),
        (r#"\"horizon_s\":0.7,"#, "", "horizon_s"),
        (r#"\"activation\":\"tanh\""#, r#"\"activation\":\"relu\""#, "activation"),
        (r#"\"ansatz\":\"direct\""#, r#"\"ansatz\":\"magic\""#, "hard-linear"),
        (r#"\"skip\":false"#, r#"\"skip\":\"dense\""#, "skip"),
        (r#"\"states\":[\"x1\",\"x2\"]"#, r#"\"states\":[\"x1\"]"#, "number per variable"),
        (r#""layers.1.bias""#, r#""layers.1.basis""#, "layers.1.bias"),
        (r#""layers.0.weight""#, r#""layers.9.weight""#, "layers.0.weight"),
        (r#""layers.3.weight""#, r#""layers.9.weight""#, "layers.2.weight"),
        (r#""shape":[6,6]"#, r#""shape":[9,4]"#, "shape"),
        (r#""shape":[6,4]"#, r#""shape":[4,6]"#, "layers.0.weight"),
    ];
    for (from, to, named) in cases {
        let damaged = with_header(&bytes, |header| {
            assert!(header.contains(from), "{from} in {header}");
            header.replacen(from, to, 1)
        });
        let message = PincNet::from_bytes(&damaged).unwrap_err().to_string();
        assert!(message.contains(named), "{from}: {message}");
    }
}

#[test]
fn the_domain_may_be_written_in_three_ways() {
    let net = net(&VanDerPol::default(), Ansatz::Direct, false);
    let flat = r#"\"domain\":{\"high\":[6.0,6.0,3.0],\"low\":[0.5,0.5,-1.0]}"#;
    let others = [
        r#"\"domain\":{\"state_low\":[0.5,0.5],\"state_high\":[6,6],\"input_low\":[-1],\"input_high\":[3]}"#,
        r#"\"domain\":{\"states\":{\"low\":[0.5,0.5],\"high\":[6,6]},\"inputs\":{\"low\":[-1],\"high\":[3]}}"#,
    ];
    for other in others {
        let bytes = with_header(&net.to_bytes(), |header| {
            assert!(header.contains(flat), "{header}");
            header.replacen(flat, other, 1)
        });
        assert_eq!(PincNet::from_bytes(&bytes).unwrap(), net);
    }
    for wrong in [r#"\"domain\":{\"high\":[6],\"low\":[1]}"#, r#"\"domain\":7"#] {
        let bytes = with_header(&net.to_bytes(), |header| header.replacen(flat, wrong, 1));
        assert!(PincNet::from_bytes(&bytes).unwrap_err().to_string().contains("omain"));
    }
}

#[test]
fn weights_that_are_not_finite_are_refused() {
    let mut bytes = net(&VanDerPol::default(), Ansatz::Direct, false).to_bytes();
    let last = bytes.len() - 8;
    bytes[last..].copy_from_slice(&f64::NAN.to_le_bytes());
    let error = PincNet::from_bytes(&bytes).unwrap_err();
    assert!(matches!(error, ModelError::Tensor { .. }), "{error}");
}

proptest! {
    #[test]
    fn a_truncated_file_is_an_error(fraction in 0.0..1.0_f64) {
        let bytes = net(&VanDerPol::default(), Ansatz::Direct, false).to_bytes();
        #[expect(clippy::cast_possible_truncation, reason = "a length")]
        let length = (fraction * bytes.len() as f64) as usize;
        prop_assert!(PincNet::from_bytes(&bytes[..length]).is_err());
    }

    #[test]
    fn any_bytes_are_an_error_not_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(PincNet::from_bytes(&bytes).is_err());
    }

    #[test]
    fn a_changed_byte_never_panics(place in any::<prop::sample::Index>(), value in any::<u8>()) {
        let mut bytes = net(&VanDerPol::default(), Ansatz::Direct, false).to_bytes();
        let place = place.index(bytes.len());
        bytes[place] = value;
        let _ = PincNet::from_bytes(&bytes);
    }
}

/// A domain without a width scales nothing.
#[test]
fn ends_of_a_domain_differ() {
    let domain = |low: f64| Domain::new([low..=1.0], [0.0..=1.0]).validate(Dims::new(1, 1));
    assert!(domain(0.999).is_ok());
    let error = domain(1.0).unwrap_err().to_string();
    assert!(error.contains("state_low") && error.contains("less than the upper end"), "{error}");
}
