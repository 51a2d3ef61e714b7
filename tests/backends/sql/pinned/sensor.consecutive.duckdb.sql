-- rvaft sql duckdb
-- The attack-fault tree "alarm" under consecutive: every match.
-- v1 Room
-- v2 Value
-- events(trace, pos, event, time): the log, its number from 1, the event as JSON, nanoseconds or NULL.
-- time ["ts"] as s
WITH
  place_1 AS MATERIALIZED (
    SELECT trace, pos, event, time, row_number() OVER (PARTITION BY trace ORDER BY pos) AS place FROM events WHERE ((json_type(event, '/room') IS NOT NULL AND json_type(event, '/value') IS NOT NULL AND coalesce(CASE WHEN json_type(event, '/value') IN ('BIGINT', 'UBIGINT') THEN CAST(json_extract_string(event, '/value') AS BIGINT) END >= 30, CAST('30.0' AS DOUBLE) <= CASE WHEN json_type(event, '/value') = 'DOUBLE' THEN CAST(json_extract_string(event, '/value') AS DOUBLE) END)) OR (json_type(event, '/room') IS NOT NULL AND json_extract_string(event, '/value') = 'door') OR (json_extract_string(event, '/event') = 'window'))
  ),
  shift_1 AS MATERIALIZED (
    SELECT 0 AS shift UNION ALL SELECT 1 AS shift UNION ALL SELECT 2 AS shift
  ),
  n1 AS MATERIALIZED (
    SELECT trace, pos, CASE WHEN json_type(event, '/room') IN ('BIGINT', 'UBIGINT') THEN 'n' || json_extract_string(event, '/room') WHEN json_type(event, '/room') = 'DOUBLE' THEN CASE WHEN CAST(json_extract_string(event, '/room') AS DOUBLE) = floor(CAST(json_extract_string(event, '/room') AS DOUBLE)) AND abs(CAST(json_extract_string(event, '/room') AS DOUBLE)) < 9e18 THEN 'n' || CAST(CAST(json_extract_string(event, '/room') AS DOUBLE) AS BIGINT) ELSE 'n' || CAST(json_extract_string(event, '/room') AS DOUBLE) END WHEN json_type(event, '/room') = 'VARCHAR' THEN 's' || json_extract_string(event, '/room') WHEN json_type(event, '/room') IN ('OBJECT', 'ARRAY') THEN (SELECT 'c' || string_agg(fullkey || ' ' || CASE WHEN type = 'DOUBLE' THEN CASE WHEN CAST(atom AS DOUBLE) = floor(CAST(atom AS DOUBLE)) AND abs(CAST(atom AS DOUBLE)) < 9e18 THEN 'n' || CAST(CAST(atom AS DOUBLE) AS BIGINT) ELSE 'n' || CAST(atom AS DOUBLE) END WHEN type IN ('BIGINT', 'UBIGINT') THEN 'n' || CAST(atom AS VARCHAR) WHEN atom IS NULL THEN type ELSE CAST(atom AS VARCHAR) END, chr(10) ORDER BY fullkey) FROM json_tree(CAST(json_extract(event, '/room') AS VARCHAR))) ELSE coalesce(json_extract_string(event, '/room'), 'null') END AS v1_key, CAST(json_extract(event, '/room') AS VARCHAR) AS v1_json, CAST(json_extract(event, '/value') AS VARCHAR) AS v2_json, time, place - shift AS start, shift AS place FROM place_1, shift_1 WHERE json_type(event, '/room') IS NOT NULL AND json_type(event, '/value') IS NOT NULL AND coalesce(CASE WHEN json_type(event, '/value') IN ('BIGINT', 'UBIGINT') THEN CAST(json_extract_string(event, '/value') AS BIGINT) END >= 30, CAST('30.0' AS DOUBLE) <= CASE WHEN json_type(event, '/value') = 'DOUBLE' THEN CAST(json_extract_string(event, '/value') AS DOUBLE) END)
  ),
  n2 AS MATERIALIZED (
    SELECT trace, pos, CASE WHEN json_type(event, '/room') IN ('BIGINT', 'UBIGINT') THEN 'n' || json_extract_string(event, '/room') WHEN json_type(event, '/room') = 'DOUBLE' THEN CASE WHEN CAST(json_extract_string(event, '/room') AS DOUBLE) = floor(CAST(json_extract_string(event, '/room') AS DOUBLE)) AND abs(CAST(json_extract_string(event, '/room') AS DOUBLE)) < 9e18 THEN 'n' || CAST(CAST(json_extract_string(event, '/room') AS DOUBLE) AS BIGINT) ELSE 'n' || CAST(json_extract_string(event, '/room') AS DOUBLE) END WHEN json_type(event, '/room') = 'VARCHAR' THEN 's' || json_extract_string(event, '/room') WHEN json_type(event, '/room') IN ('OBJECT', 'ARRAY') THEN (SELECT 'c' || string_agg(fullkey || ' ' || CASE WHEN type = 'DOUBLE' THEN CASE WHEN CAST(atom AS DOUBLE) = floor(CAST(atom AS DOUBLE)) AND abs(CAST(atom AS DOUBLE)) < 9e18 THEN 'n' || CAST(CAST(atom AS DOUBLE) AS BIGINT) ELSE 'n' || CAST(atom AS DOUBLE) END WHEN type IN ('BIGINT', 'UBIGINT') THEN 'n' || CAST(atom AS VARCHAR) WHEN atom IS NULL THEN type ELSE CAST(atom AS VARCHAR) END, chr(10) ORDER BY fullkey) FROM json_tree(CAST(json_extract(event, '/room') AS VARCHAR))) ELSE coalesce(json_extract_string(event, '/room'), 'null') END AS v1_key, time, place - shift AS start, shift AS place FROM place_1, shift_1 WHERE json_type(event, '/room') IS NOT NULL AND json_extract_string(event, '/value') = 'door'
  ),
  n3 AS MATERIALIZED (
    SELECT trace, pos, time, place - shift AS start, shift AS place FROM place_1, shift_1 WHERE json_extract_string(event, '/event') = 'window'
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
