"""The style sheet of a report, for wide and for narrow screens."""

STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; margin: 0 auto; max-width: 76rem; padding: 1rem; }
h1, h2 { line-height: 1.2; overflow-wrap: anywhere; }
nav ul { column-gap: 1.25rem; display: flex; flex-wrap: wrap; list-style: none; padding: 0; }
table { border-collapse: collapse; font-size: .875rem; }
th, td { padding: .25rem .75rem .25rem 0; text-align: left; vertical-align: top; }
th { border-bottom: 1px solid; }
.number { font-variant-numeric: tabular-nums; text-align: right; white-space: nowrap; }
td.number + td:last-child:not(.number) { min-width: 12rem; }
/* A shadow at each side on which there is more to scroll to, and a scroll bar that is always there. */
.wide, pre { overflow-x: auto; background:
  linear-gradient(to right, Canvas 1.5rem, transparent 3rem) 0 0 / 3rem 100% no-repeat local,
  linear-gradient(to left, Canvas 1.5rem, transparent 3rem) 100% 0 / 3rem 100% no-repeat local,
  linear-gradient(to right, #8889, transparent) 0 0 / .9rem 100% no-repeat scroll,
  linear-gradient(to left, #8889, transparent) 100% 0 / .9rem 100% no-repeat scroll; }
.wide::-webkit-scrollbar, pre::-webkit-scrollbar { height: .5rem; }
.wide::-webkit-scrollbar-thumb, pre::-webkit-scrollbar-thumb { background: #888; border-radius: .25rem; }
.pictures { align-items: start; display: grid; gap: 1.5rem;
  grid-template-columns: repeat(auto-fit, minmax(min(30rem, 100%), 1fr)); }
figure { margin: 0; }
img { background: #fff; display: block; height: auto; max-width: 100%; }
figcaption { font-size: .875rem; }
.close { display: none; }
.picture:target { background: Canvas; inset: 0; overflow: auto; padding: 1rem; position: fixed; z-index: 1; }
.picture:target img { margin: auto; max-width: none; }
.picture:target .close { background: Canvas; display: inline-block; inset: 0 auto auto 0; padding: .5rem;
  position: sticky; }
pre { font-size: .8125rem; }
code.root { overflow-wrap: anywhere; }
"""
