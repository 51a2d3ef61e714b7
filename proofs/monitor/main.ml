(* The command `rvaft-verified`: the extracted monitor on JSON Lines. *)

open Rvaft_monitor

let usage = "usage: rvaft-verified TREE.json [LOG.jsonl] [--semantics strict|projected|consecutive|scattered]
         [--kind fault|attack] [--choose '{\"NODE\": \"CHILD\", ...}'] [--repeat] [--complete] [--traces]
       rvaft-verified TREE.json --certify TEXT.json [--semantics S] [--kind K] [--choose CHOICES] [--limit N]

Write TREE.json by `rvaft show TREE --format json -o TREE.json`. Without LOG, or for -, events come from
standard input. One line per event is printed: {\"event\": 1, \"verdict\": \"unknown\"}. With --traces each line
is a list of events, and one line per trace is printed: T, F or ? after each event.
With --complete the log has ended, so that what it lacks will not come: a detection by that has a line more,
and each line of --traces a sign more.
--choose names a child for each `or` that a branch reaches; CHOICES is such an object.
With --certify, a text of LTLf, HOA or RML, which `rvaft emit --certify` writes as JSON, is compared with
the tree for all traces; N bounds the comparison.
Exit status: 0 nothing detected, 1 a detection, 2 an error; 0 certified, 1 the text differs, 2 not decided."

exception Usage of string

let fail format = Printf.ksprintf (fun message -> raise (Usage message)) format

let words = [ Top, "true"; Bottom, "false"; Unknown, "unknown" ]
let sign = function Top -> 'T' | Bottom -> 'F' | Unknown -> '?'

let open_file name = if Sys.file_exists name && Sys.is_directory name then fail "%s: a folder, not a file" name else
    open_in_bin name

(* The whole of a file or pipe. *)
let read_file name =
  let channel = open_file name and found = Buffer.create 65_536 in
  let rec go () = match Buffer.add_channel found channel 65_536 with () -> go () | exception End_of_file ->
      Buffer.contents found in
  match Fun.protect ~finally:(fun () -> close_in channel) go with
  | found -> found
  | exception Sys_error why -> fail "%s: %s" name why

let hint = "write one by: rvaft show TREE --format json -o TREE.json"

(* The node and child of each choice. *)
let choices_of written =
  let wrong why =
    fail "--choose takes a JSON object with a child for each `or`, as {\"NODE\": \"CHILD\"}, not %s%s" written why in
  match Json.parse written with
  | Json.Object fields -> List.map (fun (n, c) -> match c with
      | Json.String c -> (Json.text_of n, Json.text_of c)
      | _ -> wrong "") fields
  | _ -> wrong ""
  | exception Json.Bad (place, why) -> wrong (Printf.sprintf " (byte %d: %s)" place why)

let is_blank line = String.for_all (fun c -> c = ' ' || c = '\t' || c = '\r') line

let run () =
  let tree_file = ref None and log_file = ref None and semantics = ref None and kind = ref None in
  let choices = ref None and repeat = ref false and complete = ref false and traces = ref false in
  let certify = ref None and limit = ref None in
  let rec options = function
    | "--semantics" :: s :: rest -> semantics := Some s; options rest
    | "--kind" :: k :: rest -> kind := Some k; options rest
    | "--choose" :: c :: rest ->
      if !choices <> None then fail "--choose is given twice: name all choices in one object";
      choices := Some (choices_of c); options rest
    | "--certify" :: file :: rest -> certify := Some file; options rest
    | "--limit" :: n :: rest -> (match int_of_string_opt n with Some n when n > 0 -> limit := Some n | _ ->
        fail "--limit takes a number, not %s" n); options rest
    | "--repeat" :: rest -> repeat := true; options rest
    | "--complete" :: rest -> complete := true; options rest
    | "--traces" :: rest -> traces := true; options rest
    | ("--help" | "-h") :: _ -> print_endline usage; exit 0
    | option :: _ when String.length option > 1 && option.[0] = '-' -> fail "unknown or incomplete option %s" option
    | file :: rest ->
      (match !tree_file, !log_file with
       | None, _ -> tree_file := Some file
       | Some _, None -> log_file := Some file
       | Some _, Some _ -> fail "one tree and one log are read, not also %s" file);
      options rest
    | [] -> () in
  options (List.tl (Array.to_list Sys.argv));
  let tree_file = match !tree_file with Some f -> f | None -> fail "no tree is given; %s" hint in
  if !certify <> None && !repeat then
      fail "--repeat and --certify exclude each other: a text is compared until a detection";
  if !certify <> None && !complete then fail "--complete and --certify exclude each other";
  if !certify <> None && !traces then fail "--traces and --certify exclude each other";
  if !certify <> None && !log_file <> None then fail "with --certify no log is read";
  if !certify = None && !limit <> None then fail "--limit bounds the comparison of --certify, which is not given";
  let read, time =
    try
      let read = Tree_reader.read (Json.parse (read_file tree_file)) in
      (read, if !certify = None then Option.map Tree_reader.time_of read.Tree_reader.time else None)
    with
    | Json.Bad (place, why) -> fail "%s: byte %d: %s; %s" tree_file place why hint
    | Tree_reader.Refused why | Clock.Refused why -> fail "%s: %s" tree_file why in
  let tree = read.Tree_reader.tree in
  let semantics = match (match !semantics with Some s -> Some s | None -> read.Tree_reader.semantics) with
    | None | Some "projected" -> Projected | Some "strict" -> Strict
    | Some "consecutive" -> Consecutive | Some "scattered" -> Scattered
    | Some other -> fail "unknown semantics %s" other in
  let choice (name, child) = match read.Tree_reader.numbers name with
    | None -> fail "--choose: no node %s in the tree" name
    | Some n ->
      let node = List.nth tree.nodes n in
      if node.gate_of <> Or then fail "--choose: the node %s is no `or`" name;
      let children = List.map (List.nth read.Tree_reader.names) node.children in
      if not (List.mem child children) then
        fail "--choose: the node %s has no child %s; its children are %s" name child (String.concat ", " children);
      (n, [ Option.get (read.Tree_reader.numbers child) ]) in
  let selection = match !kind, !choices with
    | None, None -> Everything
    | Some "fault", None -> OfKind Fault
    | Some "attack", None -> OfKind Attack
    | Some other, None -> fail "unknown kind %s" other
    | None, Some choices -> OneBranch (List.map choice choices)
    | Some _, Some _ -> fail "--kind and --choose exclude each other" in
  let start = first_after tree selection in
  let begin_ = start [] in
  (* The first state follows the feasible scenarios that are selected. *)
  let scenarios = match begin_ with Pruned (Active []) | Watched (Watching (_, [])) -> false | _ -> true in
  (match scenarios, selection with
   | false, OfKind k when not (List.exists (has_kind tree k) (branches tree)) ->
     fail "no branch has the kind %s" (Option.get !kind)
   | false, Everything -> fail "%s: no feasible scenario" tree_file
   | false, OneBranch _ -> fail "no feasible scenario: --choose names a child for each `or` that the branch reaches"
   | false, OfKind _ -> fail "no feasible scenario"
   | true, _ -> ());
  match !certify with
  | Some file ->
    (match Certify.certify read selection semantics (Option.value ~default:1_000_000 !limit) (Json.parse
        (read_file file)) with
     | Certify.Holds -> print_endline "certified"; 0
     | Certify.Differs why -> print_endline why; 1
     | Certify.Unknown why | exception Tree_reader.Refused why -> fail "%s" why
     | exception Json.Bad (place, why) -> fail "%s: byte %d: %s" file place why)
  | None ->
  let step = next tree semantics in
  let step = if !repeat then next_repeated start step else step in
  let time_of_value v = match time with
    | None -> None
    | Some (path, format) -> Option.bind (Clock.at path v) (Clock.read format) in
  let detected = ref false in
  let after (seen, state) v =
    let time = time_of_value v in
    let event = mark tree.lateness seen (Tree_reader.value v) time in
    let state = step state event in
    let verdict = verdict_after state in
    if verdict = Top then detected := true;
    ((greatest seen time, state), verdict) in
  let at_end state =
    let verdict = verdict_after (finish state) in
    if verdict = Top then detected := true;
    verdict in
  let name, channel = match !log_file with
    | None | Some "-" -> "<stdin>", stdin
    | Some file -> file, open_file file in
  let parsed number line =
    let mark = "\xEF\xBB\xBF" in
    let line = if number = 1 && String.starts_with ~prefix:mark line then String.sub line 3 (String.length line - 3)
        else line in
    try Json.parse ~surrogates:!traces line with Json.Bad (place, why) ->
        fail "%s:%d: column %d: %s" name number place why in
  let rec lines number f =
    match input_line channel with
    | exception End_of_file -> ()
    | exception Sys_error why -> fail "%s: %s" name why
    | line -> if not (is_blank line) then f number (parsed number line); lines (number + 1) f in
  if !traces then
    lines 1 (fun number v -> match v with
        | Json.List events ->
          List.iteri (fun i -> function
              | Json.Object _ -> ()
              | _ -> fail "%s:%d: event %d: an event is a JSON object" name number (i + 1)) events;
          let (_, state), signs = List.fold_left (fun (now, signs) v -> let now, verdict = after now v in (now,
              sign verdict :: signs)) ((None, begin_), []) events in
          let signs = if !complete then sign (at_end state) :: signs else signs in
          print_endline (String.of_seq (List.to_seq (List.rev signs)))
        | _ -> fail "%s:%d: with --traces each line is a list of events" name number)
  else begin
    let now = ref (None, begin_) and count = ref 0 in
    lines 1 (fun number v -> match v with
        | Json.Object _ ->
          incr count;
          let next, verdict = after !now v in
          now := next;
          Printf.printf "{\"event\": %d, \"verdict\": \"%s\"}\n" !count (List.assoc verdict words)
        | _ -> fail "%s:%d: an event is a JSON object" name number);
    let state = snd !now in
    if !complete && verdict_after state <> Top && at_end state = Top then
      Printf.printf "{\"event\": %d, \"verdict\": \"true\", \"passed\": \"end of the log\"}\n" !count
  end;
  if !detected then 1 else 0

let () =
  match run () with
  | status -> exit status
  | exception Usage why -> flush stdout; prerr_endline ("rvaft-verified: " ^ why); exit 2
  | exception Sys_error why -> flush stdout; prerr_endline ("rvaft-verified: " ^ why); exit 2
  | exception Stack_overflow -> flush stdout; prerr_endline "rvaft-verified: the input is too large"; exit 2
  | exception Out_of_memory -> flush stdout; prerr_endline "rvaft-verified: out of memory"; exit 2
