//! Clients of a port.

use crate::{Served, experiment};
use pinc_config::ModelKind;
use pinc_serve::serve_clients;
use serde_json::{Value, json};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;

fn ask(stream: &TcpStream, request: &Value) -> Value {
    writeln!(&mut &*stream, "{request}").unwrap();
    let mut answer = String::new();
    BufReader::new(stream).read_line(&mut answer).unwrap();
    serde_json::from_str(&answer).unwrap()
}

/// One client is served at a time, and others are told so; the controller goes on from one to the
/// next, also where one leaves in the middle of a line.
#[test]
fn one_client_of_a_port_is_served_at_a_time() {
    let config = "van-der-pol/control.toml";
    let requests =
        [json!({ "y": [0.5, 0.1] }), json!({ "y": [0.4, 0.0] }), json!({ "y": [0.3, 0.0] })];
    let mut served = Served::new(config, &[]);
    let expected = requests.clone().map(|request| served.ask(&request)["u"].clone());
    served.end();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let experiment = experiment(config, &[]);
    thread::spawn(move || {
        serve_clients(&experiment, None, Some(ModelKind::RK4), &listener, io::sink())
    });
    let first = TcpStream::connect(address).unwrap();
    assert_eq!(ask(&first, &requests[0])["u"], expected[0]);
    let second = TcpStream::connect(address).unwrap();
    let mut told = String::new();
    BufReader::new(&second).read_to_string(&mut told).unwrap();
    let told: Value = serde_json::from_str(&told).unwrap();
    assert!(told["error"].as_str().unwrap().contains("another client"), "{told}");
    assert_eq!(ask(&first, &requests[1])["u"], expected[1]);
    write!(&mut &first, "{{\"y\": [0.").unwrap();
    drop(first);
    let third = TcpStream::connect(address).unwrap();
    assert_eq!(ask(&third, &requests[2])["u"], expected[2]);
}
