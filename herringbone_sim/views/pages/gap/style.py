"""Style of the gap page, on top of that of the other pages."""

from __future__ import annotations

STYLE = """
body { max-width: 1120px; } h1 { font-size: 27px; line-height: 1.25; max-width: 48ch; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; }
.kicker { color: var(--soft); font-size: 13px; margin: 0 0 6px; } code { font-size: .92em; }
.answers { display: grid; grid-template-columns: repeat(3, 1fr); gap: 14px; margin: 20px 0 8px; }
.answers div { background: var(--wash); border-radius: 8px; padding: 12px 16px; }
.answers span { color: var(--soft); font-size: 13px; display: block; }
.answers b { font-size: 17px; line-height: 1.3; display: block; margin: 2px 0; }
.gear { display: block; width: 100%; max-width: 960px; margin: 0 auto; }
.gear text { font-size: 13px; text-anchor: middle; fill: #5d6570; }
.gear text.half { font-size: 15px; font-weight: 600; fill: #22262c; }
.gear text.end { text-anchor: end; } .gear text.start { text-anchor: start; }
.gear .body { fill: #e6eaee; stroke: #aab2bc; stroke-width: .8; }
.gear .carrier { fill: #f6f7f9; stroke: #c3cad2; stroke-width: 12; stroke-linejoin: round; }
.gear .body.heavy { stroke: #22262c; stroke-width: 2.2; } .gear .carrier.heavy { stroke: #5d6570; }
.gear .spot { stroke: #8a939e; stroke-width: 1; } .gear .blank { stroke-dasharray: 3 3; }
.gear .spot.heavy { stroke: #22262c; stroke-width: 3.2; }
.gear g g text.name { font-size: 11px; } .gear g g text.share { font-size: 12px; }
.gear g g text[fill="#fff"] { fill: #fff; } .gear g g text[fill="#22262c"] { fill: #22262c; }
.gear g g text.share { font-weight: 700; }
.cause { display: grid; grid-template-columns: 30ch 1fr 8ch; gap: 3px 16px; align-items: center;
  padding: 7px 0; border-bottom: 1px solid var(--line); }
.cause.said b { color: #b23d00; } .cause i { font-style: normal; }
.bar { background: #eef1f4; border-radius: 3px; height: 14px; } .cause > b { font-size: 14px; }
.bar span { display: block; height: 14px; border-radius: 3px; background: #9aa5b1; }
.said .bar span { background: #D55E00; } .p { text-align: right; white-space: nowrap;
  font-weight: 600; }
.cause small { grid-column: 1 / -1; color: var(--soft); font-size: 13px; }
.rest { columns: 3; font-size: 13px; color: var(--soft); padding: 10px 0 0; list-style: none; }
.rest li { display: flex; justify-content: space-between; gap: 12px; break-inside: avoid; }
.rest li span:last-child { white-space: nowrap; padding-right: 14px; }
.two { display: grid; grid-template-columns: 1fr 1fr; gap: 34px; } .track { position: relative;
  height: 15px; min-width: 200px; background: #eef1f4; border-radius: 3px; }
.track span { position: absolute; left: 0; border-radius: 3px; } .track .before { top: 0;
  height: 15px; background: #f3c9a5; } .track .after { top: 4px; height: 7px;
  background: #0072B2; }
.track .floor { top: -2px; height: 19px; width: 2px; background: #22262c; border-radius: 0; }
.key i { display: inline-block; width: 22px; height: 9px; border-radius: 2px;
  margin: 0 5px 0 16px; }
td.role { white-space: nowrap; } tr.held td { background: #f4f8fc; } .key { font-size: 13px; }
.point { display: flex; gap: 26px; } .point b { display: block; font-size: 19px; }
.point span { color: var(--soft); font-size: 13px; }
@media (max-width: 760px) { .answers, .two { grid-template-columns: 1fr; } .rest { columns: 1; }
  .cause { grid-template-columns: 1fr 8ch; } .cause .bar { grid-row: 2; } }
"""
