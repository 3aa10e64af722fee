//! Access checks of servers on this machine. Any web page opened in a browser on this machine, and every user of the
//! machine, can reach the loopback address. But a page cannot choose the Host header, which names the server that it
//! addresses, and neither knows the token in the address that the program prints.

#[cfg(feature = "http")]
pub mod http;

/// Whether a Host header names this server by a loopback name. A page that has pointed its own domain at the loopback
/// address (DNS rebinding) sends that domain.
pub fn is_named(host: Option<&str>, port: u16) -> bool {
    let Some(host) = host else { return false };
    // Browsers omit the default port of HTTP.
    let is_port = |rest: &str| rest.strip_prefix(':').map_or(rest.is_empty() && port == 80, |p| p == port.to_string());
    ["127.0.0.1", "localhost", "[::1]"].iter().any(|name| host.strip_prefix(name).is_some_and(is_port))
}

/// Whether the path of an address is the token.
pub fn has_token(path: &str, token: &str) -> bool {
    same_bytes(path.strip_prefix('/').unwrap_or(path).as_bytes(), token.as_bytes())
}

/// Comparison in constant time, which does not reveal how much was right.
fn same_bytes(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |differences, (a, b)| differences | (a ^ b)) == 0
}

/// A random 128-bit token as text for an address.
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
