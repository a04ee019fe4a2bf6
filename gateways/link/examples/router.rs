//! A Zenoh router for tests: `router ENDPOINT…`, with `RCC_LINK_AUTHORITY`, `_CERTIFICATE` and `_KEY` for TLS. In production it is
//! `zenohd`; both pass on what the cells and programs that connect to it send to each other. Runs until it is killed.

use rcc_config::link::TlsFiles;
use rcc_link::session;

fn files() -> Option<TlsFiles> {
    let file = |name| std::env::var_os(name).map(Into::into);
    Some(TlsFiles {
        authority: file("RCC_LINK_AUTHORITY")?,
        certificate: file("RCC_LINK_CERTIFICATE")?,
        key: file("RCC_LINK_KEY")?,
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let listen: Vec<String> = std::env::args().skip(1).collect();
    let _session = session::route(&listen, &[], files().as_ref())?;
    println!("ready");
    loop {
        std::thread::park();
    }
}
