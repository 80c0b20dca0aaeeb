//! `GET /problems/{slug}`: what the `type` of a problem document refers to.

use super::openapi::answers::ProblemsOf;
use super::openapi::bodies::{AnyObject, Text};
use super::openapi::examples;
use super::openapi::parameters::ProblemPath;
use crate::extract::accept;
use crate::problem::{Kind, Problem};
use axum::Json;
use axum::extract::Path;
use axum::http::HeaderMap;
use axum::http::header::{CONTENT_SECURITY_POLICY, VARY};
use axum::response::{Html, IntoResponse, Response};

/// The page has its styles inline, and loads nothing.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; form-action 'none'; \
                      base-uri 'none'; frame-ancestors 'none'";
const STYLE: &str = ":root{color-scheme:light dark}\
                     body{font:1.0625rem/1.5 system-ui,sans-serif;max-width:42rem;\
                     margin:3rem auto;padding:0 1rem}\
                     h1{font-size:1.5rem}h2{font-size:1.125rem;margin-top:2rem}\
                     pre{padding:1rem;overflow-x:auto;border:1px solid #8888;border-radius:.25rem}";

/// Answers with the row of the table of problems, as JSON or as a page.
///
/// # Errors
/// `not-found` for a slug that is in no row.
#[utoipa::path(
    get, path = "/problems/{slug}", operation_id = "problem",
    summary = "The cause and the remedy of a problem's type",
    description = "The type of every problem document is a reference to this resource. A browser \
                   gets a page; other clients get JSON.",
    params(ProblemPath),
    responses(
        (
            status = 200, description = "The type, status, title, cause, example and remedy",
            content((inline(AnyObject) = "application/json"), (inline(Text) = "text/html")),
        ),
        ProblemsOf::<404>,
    ),
)]
pub async fn show(Path(slug): Path<String>, request: HeaderMap) -> Result<Response, Problem> {
    let kind = Kind::ALL.iter().find(|kind| kind.slug() == slug);
    let kind = *kind.ok_or_else(|| {
        Problem::new(
            Kind::NotFound,
            "no type of problem has this name; GET /openapi.json lists them",
        )
    })?;
    let answer = if accept::prefers(&request, "text/html", "application/json") {
        ([(CONTENT_SECURITY_POLICY, POLICY)], Html(page(kind))).into_response()
    } else {
        let mut document = kind.document();
        document.insert("cause".into(), kind.cause().into());
        document.insert("example".into(), examples::problem(kind));
        document.insert("remedy".into(), kind.remedy().into());
        Json(document).into_response()
    };
    Ok(([(VARY, "Accept")], answer).into_response())
}

fn page(kind: Kind) -> String {
    let (status, slug) = (kind.status().as_u16(), kind.slug());
    let [title, cause, remedy, example] =
        [kind.title(), kind.cause(), kind.remedy(), &format!("{:#}", examples::problem(kind))]
            .map(escaped);
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{title} - pixmesh</title>\n<style>{STYLE}</style>\n\
         <h1>{title}</h1>\n<p>Status {status}, type <code>/problems/{slug}</code></p>\n\
         <h2>Cause</h2>\n<p>{cause}</p>\n<h2>Example</h2>\n<pre>{example}</pre>\n\
         <h2>Remedy</h2>\n<p>{remedy}</p>\n</html>\n"
    )
}

/// A text as it stands between the tags of a page.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}
