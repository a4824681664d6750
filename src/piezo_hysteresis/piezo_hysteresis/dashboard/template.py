"""The frame of the page: HTML and CSS for the bench screen and the phone."""

from __future__ import annotations

from jinja2 import Environment, Template

from piezo_hysteresis.reporting.page_style import EXPORT_SCRIPT, EXPORT_STYLE, STYLE

# Widgets of Bokeh are in shadow trees, which styles of the page do not affect.
WIDGET_STYLE = """
:host { font: 14px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif;
  color: #1b1f24; overflow-wrap: anywhere; }
.soft, .unit { color: #57606a; } .soft { font-size: 13px; }
p { margin: .3rem 0; }
.error, :host(.refusal) { color: #a40e26; }
.warning { color: #8a4600; }
.good { color: #00593f; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px; }
th, td { text-align: left; padding: .15rem .9rem .15rem 0; vertical-align: top;
  border-bottom: 1px solid #d0d7de; overflow-wrap: normal; }
td:first-child { white-space: nowrap; }
code { background: #f3f4f6; padding: .05em .3em; border-radius: 3px; }
a { color: #0072b2; font-weight: 600; }
.banner { background: #fff4e5; border-left: 5px solid #d55e00; padding: .6rem .9rem;
  font-size: 15px; }
.dot { display: inline-block; width: .7em; height: .7em; border-radius: 50%; margin-right: .45em; }
.dot.ok { background: #009e73; } .dot.warning { background: #e69f00; }
.dot.error, .dot.gone { background: #d5001c; }
.banner.calm { background: #f2f8fc; border-left-color: #0072b2; }
abbr { text-decoration: underline dotted #8c959f; text-underline-offset: 2px; cursor: help; }
:host(.brief) { display: grid; gap: 0 .8rem;
  grid-template-columns: repeat(auto-fill, minmax(155px, 1fr)); }
:host(.brief) > .refusal { grid-column: 1 / -1; }
.tick { display: inline-block; width: .6em; height: .6em; border-radius: 50%; margin-right: .4em;
  background: #009e73; }
.tick.warning { background: #e69f00; } .tick.error, .tick.gone { background: #d5001c; }
"""

# The switch before its name.
SWITCH_STYLE = """
:host { flex-direction: row-reverse; justify-content: flex-end; font-size: 13px; }
"""

_PAGE = """{% from macros import embed %}<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="__POLICY__">
<link rel="icon" href="data:,">
<title>{{ title | e }}</title>
<style>__STYLE__</style>
{{ bokeh_css if bokeh_css }}
{{ bokeh_js if bokeh_js }}
</head>
<body>
<main>
<header><h1>{{ title | e }}</h1>{{ embed(roots.actuator) }}{{ embed(roots.pulse) }}</header>
{{ embed(roots.banner) }}
<div class="page">
<section class="pictures" aria-label="Signals">
<div class="view">{{ embed(roots.view) }}</div>
<div class="plots">
<figure class="first">{{ embed(roots.loop) }}</figure>
<figure class="first">{{ embed(roots.trace) }}</figure>
<figure>{{ embed(roots.spectrum) }}</figure>
<figure class="first">{{ embed(roots.error) }}{{ embed(roots.tracking) }}</figure>
</div>
<details open class="more"><summary>Gap, voltage, estimate</summary>
<div class="plots">
<figure>{{ embed(roots.gap) }}{{ embed(roots.gap_text) }}</figure>
<figure>{{ embed(roots.voltage) }}</figure>
<figure>{{ embed(roots.estimate) }}{{ embed(roots.estimate_choice) }}</figure>
<figure>{{ embed(roots.estimates) }}</figure>
</div>
</details>
<details open><summary>Effects of the simulator</summary>{{ embed(roots.effects) }}</details>
<details open><summary>Nodes</summary>{{ embed(roots.status) }}</details>
</section>
<aside class="controls" aria-label="Controls">
<details open class="first"><summary>Drive</summary>{{ embed(roots.drive) }}</details>
<details open><summary>Sweep</summary>{{ embed(roots.sweep) }}</details>
<details open><summary>Discovery</summary>{{ embed(roots.discovery) }}</details>
<details open><summary>Investigation</summary>{{ embed(roots.investigation) }}</details>
<details><summary>All parameters</summary>{{ embed(roots.all) }}</details>
</aside>
</div>
<noscript>This page needs JavaScript; all of it comes from this machine.</noscript>
</main>
{{ plot_script }}
<script>// on a phone, what is secondary is folded
if (matchMedia('(max-width: 900px)').matches) {
  document.querySelectorAll('details:not(.first)').forEach((part) => { part.open = false; });
}
__EXPORT__
const waiting = setInterval(() => {
  addExports();
  if (document.querySelectorAll('.export').length >= __FIGURES__) clearInterval(waiting);
}, 500);
</script>
</body>
</html>
"""

_STYLE = (
    STYLE
    + EXPORT_STYLE
    + """
main { max-width: 1720px; padding-top: .4rem; }
header { display: flex; flex-wrap: wrap; align-items: center; gap: .2rem 1.2rem;
  margin-bottom: .4rem; }
h1 { margin: 0; font-size: 1.3rem; }
.page { display: grid; gap: 1.4rem; grid-template-columns: minmax(0, 1fr) minmax(330px, 400px); }
.pictures .plots { gap: .6rem 1.2rem; margin: .2rem 0; align-items: start;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 400px), 1fr)); }
.controls { min-width: 0; }
details { border: 1px solid var(--line); border-radius: 6px; margin-bottom: .7rem;
  padding: 0 .7rem .3rem; }
summary { cursor: pointer; font-weight: 600; padding: .45rem 0; }
figure { margin-bottom: .4rem; }
@media (max-width: 900px) {
  .page { display: flex; flex-direction: column; gap: .6rem; }
  .pictures, .plots, .controls { display: contents; }
  .page figure, .page details { order: 3; margin: 0; }
  .page .view { order: 1; }
  .page figure.first { order: 1; }
  .page details.first { order: 2; }
}
"""
)

# No external content; Bokeh compiles the callbacks of the page to functions.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; "
    "connect-src 'self' ws:"
)

_FIGURES = ('loop', 'trace', 'spectrum', 'error', 'gap', 'voltage', 'estimate')

PAGE = (
    _PAGE.replace('__STYLE__', _STYLE)
    .replace('__POLICY__', _POLICY)
    .replace('__EXPORT__', EXPORT_SCRIPT)
    .replace('__FIGURES__', str(len(_FIGURES)))
)


def page_template() -> Template:
    """Return the template of the document."""
    return Environment(autoescape=False).from_string(PAGE)
