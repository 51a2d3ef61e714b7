-- rvaft sql postgres
-- The attack-fault tree "alarm" under consecutive: every match.
-- v1 Room
-- v2 Value
-- events(trace, pos, event, time): the log, its number from 1, the event as JSON, nanoseconds or NULL.
-- time ["ts"] as s
WITH
  place_1 AS MATERIALIZED (
    SELECT trace, pos, event, time, row_number() OVER (PARTITION BY trace ORDER BY pos) AS place FROM events WHERE ((json_typeof(json_extract_path(event::json, 'room')) IS NOT NULL AND json_typeof(json_extract_path(event::json, 'value')) IS NOT NULL AND coalesce(CASE WHEN json_typeof(json_extract_path(event::json, 'value')) = 'number' AND json_extract_path_text(event::json, 'value') ~ '^-?[0-9]+$' THEN CAST(json_extract_path_text(event::json, 'value') AS bigint) END >= 30, CAST('30.0' AS double precision) <= CASE WHEN json_typeof(json_extract_path(event::json, 'value')) = 'number' AND json_extract_path_text(event::json, 'value') !~ '^-?[0-9]+$' THEN CAST(json_extract_path_text(event::json, 'value') AS double precision) END)) OR (json_typeof(json_extract_path(event::json, 'room')) IS NOT NULL AND json_extract_path_text(event::json, 'value') = 'door') OR (json_extract_path_text(event::json, 'event') = 'window'))
  ),
  shift_1 AS MATERIALIZED (
    SELECT 0 AS shift UNION ALL SELECT 1 AS shift UNION ALL SELECT 2 AS shift
  ),
  n1 AS MATERIALIZED (
    SELECT trace, pos, CASE WHEN json_typeof(json_extract_path(event::json, 'room')) = 'number' AND json_extract_path_text(event::json, 'room') ~ '^-?[0-9]+$' THEN to_jsonb(json_extract_path_text(event::json, 'room')::bigint) WHEN json_typeof(json_extract_path(event::json, 'room')) = 'number' THEN CASE WHEN json_extract_path_text(event::json, 'room')::float8 = floor(json_extract_path_text(event::json, 'room')::float8) AND abs(json_extract_path_text(event::json, 'room')::float8) < 9e18 THEN to_jsonb(json_extract_path_text(event::json, 'room')::float8::bigint) ELSE to_jsonb(json_extract_path_text(event::json, 'room')::float8) END ELSE (json_extract_path(event::json, 'room')::text)::jsonb END AS v1_key, json_extract_path(event::json, 'room')::text AS v1_json, json_extract_path(event::json, 'value')::text AS v2_json, time, place - shift AS start, shift AS place FROM place_1, shift_1 WHERE json_typeof(json_extract_path(event::json, 'room')) IS NOT NULL AND json_typeof(json_extract_path(event::json, 'value')) IS NOT NULL AND coalesce(CASE WHEN json_typeof(json_extract_path(event::json, 'value')) = 'number' AND json_extract_path_text(event::json, 'value') ~ '^-?[0-9]+$' THEN CAST(json_extract_path_text(event::json, 'value') AS bigint) END >= 30, CAST('30.0' AS double precision) <= CASE WHEN json_typeof(json_extract_path(event::json, 'value')) = 'number' AND json_extract_path_text(event::json, 'value') !~ '^-?[0-9]+$' THEN CAST(json_extract_path_text(event::json, 'value') AS double precision) END)
  ),
  n2 AS MATERIALIZED (
    SELECT trace, pos, CASE WHEN json_typeof(json_extract_path(event::json, 'room')) = 'number' AND json_extract_path_text(event::json, 'room') ~ '^-?[0-9]+$' THEN to_jsonb(json_extract_path_text(event::json, 'room')::bigint) WHEN json_typeof(json_extract_path(event::json, 'room')) = 'number' THEN CASE WHEN json_extract_path_text(event::json, 'room')::float8 = floor(json_extract_path_text(event::json, 'room')::float8) AND abs(json_extract_path_text(event::json, 'room')::float8) < 9e18 THEN to_jsonb(json_extract_path_text(event::json, 'room')::float8::bigint) ELSE to_jsonb(json_extract_path_text(event::json, 'room')::float8) END ELSE (json_extract_path(event::json, 'room')::text)::jsonb END AS v1_key, time, place - shift AS start, shift AS place FROM place_1, shift_1 WHERE json_typeof(json_extract_path(event::json, 'room')) IS NOT NULL AND json_extract_path_text(event::json, 'value') = 'door'
  ),
  n3 AS MATERIALIZED (
    SELECT trace, pos, time, place - shift AS start, shift AS place FROM place_1, shift_1 WHERE json_extract_path_text(event::json, 'event') = 'window'
  )
SELECT e1.trace, greatest(e2.pos, e3.pos) AS detected, 1 AS branch,
  '{"warm": ' || e1.pos || ', "door": ' || e2.pos || ', "window": ' || e3.pos || '}' AS nodes, '{"Room": ' || e1.v1_json || ', "Value": ' || e1.v2_json || '}' AS variables
FROM n1 AS e1, n2 AS e2, n3 AS e3
WHERE e2.trace = e1.trace
  AND e3.trace = e1.trace
  AND e2.start = e1.start
  AND e3.start = e1.start
  AND e1.place = 0
  AND e2.place BETWEEN 1 AND 2
  AND e3.place BETWEEN 1 AND 2
  AND e2.place <> e3.place
  AND e2.v1_key = e1.v1_key
  AND e2.time <= e1.time + 600000000000 AND e1.time <= e2.time + 600000000000
  AND e3.time <= e1.time + 600000000000 AND e1.time <= e3.time + 600000000000
  AND e3.time <= e2.time + 600000000000 AND e2.time <= e3.time + 600000000000
