//! The files of the page, embedded: no folder to install, no build step, nothing from the network. Served by the one
//! serving thread.

use axum::extract::Path;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};

/// A file of the page.
struct Asset {
    path: &'static str,
    kind: &'static str,
    bytes: &'static [u8],
}

macro_rules! assets {
    ($($kind:literal: $($path:literal),*;)*) => {
        const ASSETS: &[Asset] = &[$($(Asset {
            path: $path,
            kind: $kind,
            bytes: include_bytes!(concat!("page/", $path)),
        },)*)*];
    };
}

assets! {
    "text/html; charset=utf-8": "index.html";
    "text/css; charset=utf-8": "style.css", "graph.css", "vendor/uPlot.min.css";
    "image/svg+xml": "icon.svg";
    "text/plain; charset=utf-8": "vendor/uPlot.LICENSE";
    "text/javascript; charset=utf-8": "app.js", "stream.js", "commands.js", "dom.js", "picker.js", "format.js", "plot.js", "series.js",
        "scene3d.js", "trigger.js", "views/overview.js", "views/nets.js", "views/net.js", "views/curves.js", "views/scope.js",
        "views/arms.js", "views/events.js", "views/incidents.js", "vendor/uPlot.iife.min.js";
}

/// Answers with the page.
pub async fn index(headers: HeaderMap) -> Response {
    found("index.html", &headers)
}

/// Answers with a file of the page.
pub async fn file(Path(path): Path<String>, headers: HeaderMap) -> Response {
    found(&path, &headers)
}

fn found(path: &str, headers: &HeaderMap) -> Response {
    let Some(asset) = ASSETS.iter().find(|asset| asset.path == path) else {
        return (StatusCode::NOT_FOUND, "no such file\n").into_response();
    };
    let tag = tag(asset.bytes);
    let sent = [
        (header::ETAG, tag.clone()),
        (header::CACHE_CONTROL, "no-cache".to_owned()),
    ];
    let known = headers.get(header::IF_NONE_MATCH);
    if known.is_some_and(|known| known.as_bytes() == tag.as_bytes()) {
        return (StatusCode::NOT_MODIFIED, sent).into_response();
    }
    (sent, [(header::CONTENT_TYPE, asset.kind)], asset.bytes).into_response()
}

/// Returns the entity tag of a file: FNV-1a of its bytes (Fowler, Noll, Vo), 64 bits.
fn tag(bytes: &[u8]) -> String {
    let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    });
    format!("\"{hash:016x}\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the text of an asset.
    fn text(asset: &Asset) -> &'static str {
        std::str::from_utf8(asset.bytes).expect("text")
    }

    #[test]
    fn a_known_file_is_not_sent_again() {
        let first = found("app.js", &HeaderMap::new());
        assert_eq!(first.status(), StatusCode::OK);
        let tag = first.headers()[header::ETAG].clone();
        let again = found(
            "app.js",
            &HeaderMap::from_iter([(header::IF_NONE_MATCH, tag)]),
        );
        assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
        assert_eq!(
            found("../serve.rs", &HeaderMap::new()).status(),
            StatusCode::NOT_FOUND
        );
    }

    #[test]
    fn nothing_is_loaded_from_elsewhere_and_every_import_is_embedded() {
        let own = ASSETS
            .iter()
            .filter(|asset| !asset.path.starts_with("vendor/"));
        for asset in own {
            let text = text(asset);
            let remote = text.replace("http://www.w3.org/", "");
            assert!(
                !remote.contains("http://") && !remote.contains("https://"),
                "{}",
                asset.path
            );
            for line in text.lines().filter(|line| line.starts_with("import")) {
                let imported = line.split(['"']).nth(1).expect("a path in double quotes");
                let folder = asset.path.rsplit_once('/').map_or("", |(folder, _)| folder);
                let path = match imported.strip_prefix("../") {
                    Some(rest) => rest.to_owned(),
                    None => format!("{folder}/{}", imported.trim_start_matches("./")),
                };
                let path = path.trim_start_matches('/');
                assert!(
                    ASSETS.iter().any(|asset| asset.path == path),
                    "{}: {path}",
                    asset.path
                );
            }
        }
    }

    #[test]
    fn no_markup_is_inline_script_or_style() {
        // The policy of the pages would block it in silence.
        let html = text(&ASSETS[0]);
        assert!(
            !html.contains("<style") && !html.contains(" style=") && !html.contains(" onclick=")
        );
        assert!(
            html.matches("<script").count()
                == html.matches("<script src=").count()
                    + html.matches("<script type=\"module\" src=").count()
        );
    }
}
