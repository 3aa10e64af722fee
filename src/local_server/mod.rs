//! What servers on this machine ask of whoever comes. A web page from anywhere, opened in a browser on this machine, can reach
//! the loopback address, and so can every user of the machine: the page cannot choose the Host header, which names the server that
//! it believes to talk to, and neither knows the token in the address that the program prints.

#[cfg(feature = "http")]
pub mod http;

/// Whether a Host header means this server by one of its own names. A page that has pointed a name of its own at the loopback
/// address (DNS rebinding) brings that name.
pub fn is_named(host: Option<&str>, port: u16) -> bool {
    let Some(host) = host else { return false };
    // Browsers leave out the port that HTTP has anyway.
    let is_port = |rest: &str| rest.strip_prefix(':').map_or(rest.is_empty() && port == 80, |p| p == port.to_string());
    ["127.0.0.1", "localhost", "[::1]"].iter().any(|name| host.strip_prefix(name).is_some_and(is_port))
}

/// Whether the path of an address holds the token.
pub fn has_token(path: &str, token: &str) -> bool {
    same_bytes(path.strip_prefix('/').unwrap_or(path).as_bytes(), token.as_bytes())
}

/// In a time that does not tell how much of it was right.
fn same_bytes(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |differences, (a, b)| differences | (a ^ b)) == 0
}

/// 128 bits that nobody can guess, as text for an address.
pub fn token() -> anyhow::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|e| anyhow::anyhow!("the system has no random numbers: {e}"))?;
    Ok(bytes.iter().map(|b| format!("{b:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_from_elsewhere_stay_out() {
        for host in ["127.0.0.1:80", "localhost:80", "[::1]:80", "127.0.0.1"] {
            assert!(is_named(Some(host), 80), "{host}");
        }
        for host in ["evil.com", "evil.com:80", "127.0.0.1:81", "127.0.0.1:80.evil.com", "127.0.0.1.evil.com", ""] {
            assert!(!is_named(Some(host), 80), "{host}");
        }
        assert!(is_named(Some("localhost:81"), 81) && !is_named(Some("localhost"), 81));
        assert!(!is_named(None, 80));
        let token = token().unwrap();
        assert_eq!(token.len(), 32);
        assert!(has_token(&format!("/{token}"), &token));
        for path in ["/", "", &format!("/{}", &token[1..]), &format!("/{token}0"), &format!("//{token}")] {
            assert!(!has_token(path, &token), "{path}");
        }
    }
}
