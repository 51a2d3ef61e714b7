-- rvaft sql sqlite
-- The attack-fault tree "alarm" under scattered: every match.
-- v1 Room
-- v2 Value
-- events(trace, pos, event, time): the log, its number from 1, the event as JSON, nanoseconds or NULL.
-- time ["ts"] as s
WITH
  n1 AS MATERIALIZED (
    SELECT trace, pos, CASE json_type(event, '$.room') WHEN 'integer' THEN event ->> '$.room' WHEN 'real' THEN event ->> '$.room' WHEN 'text' THEN 's' || (event ->> '$.room') WHEN 'true' THEN 'true' WHEN 'false' THEN 'false' WHEN 'null' THEN 'null' ELSE (SELECT 'c' || group_concat(part, char(10)) FROM (SELECT fullkey || ' ' || CASE type WHEN 'integer' THEN 'n' || atom WHEN 'real' THEN CASE WHEN atom = CAST(atom AS INTEGER) AND abs(atom) < 9e18 THEN 'n' || CAST(atom AS INTEGER) ELSE 'n' || printf('%!.17g', atom) END WHEN 'text' THEN json_quote(atom) ELSE type END AS part FROM json_tree((event -> '$.room')) ORDER BY fullkey)) END AS v1_key, (event -> '$.room') AS v1_json, (event -> '$.value') AS v2_json, time FROM events WHERE json_type(event, '$.room') IS NOT NULL AND json_type(event, '$.value') IS NOT NULL AND coalesce(CASE WHEN json_type(event, '$.value') = 'integer' THEN event ->> '$.value' END >= 30, 30.0 <= CASE WHEN json_type(event, '$.value') = 'real' THEN event ->> '$.value' END)
  ),
  n2 AS MATERIALIZED (
    SELECT trace, pos, CASE json_type(event, '$.room') WHEN 'integer' THEN event ->> '$.room' WHEN 'real' THEN event ->> '$.room' WHEN 'text' THEN 's' || (event ->> '$.room') WHEN 'true' THEN 'true' WHEN 'false' THEN 'false' WHEN 'null' THEN 'null' ELSE (SELECT 'c' || group_concat(part, char(10)) FROM (SELECT fullkey || ' ' || CASE type WHEN 'integer' THEN 'n' || atom WHEN 'real' THEN CASE WHEN atom = CAST(atom AS INTEGER) AND abs(atom) < 9e18 THEN 'n' || CAST(atom AS INTEGER) ELSE 'n' || printf('%!.17g', atom) END WHEN 'text' THEN json_quote(atom) ELSE type END AS part FROM json_tree((event -> '$.room')) ORDER BY fullkey)) END AS v1_key, time FROM events WHERE json_type(event, '$.room') IS NOT NULL AND event ->> '$.value' = 'door'
  ),
  n3 AS MATERIALIZED (
    SELECT trace, pos, time FROM events WHERE event ->> '$.event' = 'window'
  )
SELECT e1.trace, max(e2.pos, e3.pos) AS detected, 1 AS branch,
  '{"warm": ' || e1.pos || ', "door": ' || e2.pos || ', "window": ' || e3.pos || '}' AS nodes, '{"Room": ' || e1.v1_json || ', "Value": ' || e1.v2_json || '}' AS variables
FROM n1 AS e1, n2 AS e2, n3 AS e3
WHERE e2.trace = e1.trace
  AND e3.trace = e1.trace
  AND e1.pos < e2.pos
  AND e1.pos < e3.pos
  AND e2.pos <> e3.pos
  AND e2.v1_key = e1.v1_key
  AND e2.time <= e1.time + 600000000000 AND e1.time <= e2.time + 600000000000
  AND e3.time <= e1.time + 600000000000 AND e1.time <= e3.time + 600000000000
  AND e3.time <= e2.time + 600000000000 AND e2.time <= e3.time + 600000000000
