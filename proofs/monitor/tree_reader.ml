(* A tree as `rvaft show --format json` writes it. What is not known here is refused. *)

open Rvaft_monitor

exception Refused of string

let refuse format = Printf.ksprintf (fun message -> raise (Refused message)) format

(* The result of a reader, whose errors get the place in front. *)
let within place f v = try f v with Refused why -> refuse "%s: %s" place why

let undefined_values = ref 0

(* The value of JSON: numbers as they are defined, objects with sorted fields. *)
let rec value (v : Json.t) : value = match v with
  | Json.Null -> Null
  | Json.Bool b -> Bool b
  | Json.Number text ->
    (match parse_number (Json.points_of text) with
     | Some n -> Num n
     | None -> incr undefined_values; Undefined !undefined_values)
  | Json.String points -> Text points
  | Json.List items -> List (List.map value items)
  | Json.Object fields -> object0 (List.map (fun (name, v) -> (name, value v)) fields)

let field name v = match v with
  | Json.Object fields -> List.fold_left (fun found (n, v) -> if n = Json.points_of name then Some v else
      found) None fields
  | _ -> refuse "an object was expected, with the field %s" name
let need name v = match field name v with Some found -> found | None -> refuse "the field %s is missing" name
let read_field name f v = within name f (need name v)
let text v = match v with Json.String points -> Json.text_of points | _ -> refuse "a text was expected"
let items v = match v with Json.List items -> items | _ -> refuse "a list was expected"
let texts v = List.map text (items v)
let optional f v = match v with Json.Null -> None | _ -> Some (f v)
let number v = match v with
  | Json.Number text -> (match int_of_string_opt text with Some n -> n | None ->
      refuse "%s is not a small integer" text)
  | _ -> refuse "an integer was expected"
let big v = match value v with Num { mantissa; scale = N0 } -> mantissa | _ -> refuse "an integer was expected"

(* Names of variables, as numbers; [known] has those given so far. *)
let numbering_in known name = match Hashtbl.find_opt known name with
  | Some n -> n
  | None -> let n = Hashtbl.length known in Hashtbl.add known name n; n

let numbering () = let known = Hashtbl.create 16 in numbering_in known

let only v = match v with Json.Object [ (name, inner) ] -> (Json.text_of name, inner) | _ ->
    refuse "an object with one field was expected"

(* How often a parameter stands in a pattern. *)
let rec uses parameter pattern = match only pattern with
  | "variable", name -> if text name = parameter then 1 else 0
  | ("literal" | "any"), _ -> 0
  | "object", Json.Object fields -> List.fold_left (fun n (_, p) -> n + uses parameter p) 0 fields
  | "list", l -> List.fold_left (fun n p -> n + uses parameter p) 0 (items l)
  | "some", p -> uses parameter p
  | other, _ -> refuse "unknown pattern %s" other

let rec pattern rigid arguments p = match only p with
  | "literal", v -> Exactly (value v)
  | "any", _ -> Anything
  | "variable", name -> (match List.assoc_opt (text name) arguments with
      | Some found -> found
      | None -> refuse "the pattern names %s, which is no parameter" (text name))
  | "object", Json.Object fields -> ObjectWith (List.map (fun (name, p) -> (name, pattern rigid arguments p)) fields)
  | "list", l -> ListOf (List.map (pattern rigid arguments) (items l))
  | "some", p -> SomeItem (pattern rigid arguments p)
  | other, _ -> refuse "unknown pattern %s" other

(* An event type with arguments; `_` for a parameter that stands twice is one value within the event. *)
let call events rigid on =
  let name = read_field "event" text on in
  let event = match List.assoc_opt name events with
    | Some e -> e | None -> refuse "unknown event type %s" name in
  within ("event " ^ name) (fun event ->
  let shape = need "pattern" event in
  let parameters = read_field "parameters" texts event in
  let given = read_field "arguments" items on in
  if List.length parameters <> List.length given then refuse "%d arguments for %d parameters" (List.length given)
      (List.length parameters);
  let argument index parameter a = match only a with
    | "literal", v -> Exactly (value v)
    | "variable", x -> Named (Rigid (rigid (text x)))
    | "any", _ -> if uses parameter shape > 1 then Named (Local index) else Anything
    | other, _ -> refuse "unknown argument %s" other in
  let arguments = List.mapi (fun i (p, a) -> (p, argument i p a)) (List.combine parameters given) in
  within "pattern" (pattern rigid arguments) shape) event

let operators = [
  "==", Equals; "!=", Differs; "<", Less; "<=", LessOrEqual; ">", Greater; ">=", GreaterOrEqual;
  "+", Add; "-", Subtract; "*", Multiply; "/", Divide; "neg", Negate; "not", Not;
  "startswith", StartsWith; "endswith", EndsWith; "contains", Contains; "like", Like;
  "abs", Absolute; "min", Minimum; "max", Maximum; "number", ToNumber ]

let rec guard lower rigid node_number g = match field "operator" g, field "point" g with
  | Some operator, _ ->
    let operands = items (need "operands" g) in
    let inner () = List.map (guard lower rigid node_number) operands in
    let rec joined make = function [ one ] -> one | one :: rest -> make one (joined make rest) | [] ->
        refuse "no operand" in
    (match text operator with
     | "and" -> joined (fun a b -> AndThen (a, b)) (inner ())
     | "or" -> joined (fun a b -> OrElse (a, b)) (inner ())
     | "in" -> (match inner () with
         | tested :: listed ->
           Apply (OneOf (List.map (function Constant v -> v | _ -> refuse "`in` takes literals") listed), [ tested ])
         | [] -> refuse "`in` without operands")
     | "lower" -> Apply (Lower lower, inner ())
     | name -> (match List.assoc_opt name operators with
         | Some o -> Apply (o, inner ())
         | None -> refuse "the operator %s is not supported" name))
  | None, Some point ->
    let node = text (need "node" g) in
    let n = match node_number node with Some n -> n | None ->
        refuse "a time point of %s, which is not below the root" node in
    TimeOf (match text point with
        | "at" -> At n | "start" -> Start n | "end" -> End n
        | other -> refuse "unknown time point %s" other)
  | None, None -> (match only g with
      | "literal", v -> Constant (value v)
      | "variable", x -> ValueOf (rigid (text x))
      | other, _ -> refuse "unknown guard %s" other)

(* The lower case of characters, from the table that a tree with `lower` has. *)
let lower_of table =
  let known = Hashtbl.create 16 in
  (match table with
   | Some (Json.Object fields) ->
     List.iter (fun (upper, v) -> match upper, v with
         | [ c ], Json.String points -> Hashtbl.replace known c points
         | _ -> refuse "the table of lower case has one character for each text") fields
   | Some _ -> refuse "lowercase: an object was expected"
   | None -> ());
  fun c -> match Hashtbl.find_opt known c with
    | Some points -> points
    | None -> if table = None then refuse "`lower` needs the field lowercase" else [ c ]

type t = {
  tree : tree;
  time : Json.t option;                        (* the field and the format of times *)
  semantics : string option;
  numbers : string -> int option;              (* of the nodes below the root *)
  names : string list;                         (* by number *)
  variables : (string, int) Hashtbl.t;         (* the numbers of the variables of the tree *)
  lower : int -> int list;
}

(* The names of the nodes, parents before children. *)
let in_order root children =
  let seen = Hashtbl.create 16 in
  let order = ref [] in
  let rec visit name =
    if not (Hashtbl.mem seen name) then begin
      Hashtbl.add seen name ();
      List.iter visit (List.rev (children name));
      order := name :: !order
    end in
  visit root;
  !order

(* The path of a time, and its format. *)
let time_of = within "time" (fun v -> match need "format" v with
  | Json.String f ->
    (List.map (function Json.String p -> p | _ -> refuse "a path of fields was expected") (read_field "field" items v),
     Clock.format_of (Json.text_of f))
  | _ -> refuse "times in a strptime format are not supported")

let read (v : Json.t) : t =
  (match field "format" v, field "version" v with
   | Some (Json.String f), Some (Json.Number ("1" | "2")) when Json.text_of f = "rvaft" -> ()
   | _ -> refuse "not a tree in JSON of version 1 or 2; write one by: rvaft show TREE --format json -o TREE.json");
  let name_of = read_field "name" text in
  let named_items what name v = List.mapi (fun i one -> (within (Printf.sprintf "%s %d" what (i + 1)) name one, one))
      (items v) in
  let events = read_field "events" (named_items "event" name_of) v in
  let named = Hashtbl.create 16 in
  List.iter (fun (name, n) ->
      if Hashtbl.mem named name then refuse "two nodes are named %s" name;
      Hashtbl.replace named name n) (read_field "nodes" (named_items "node" name_of) v);
  let node name = match Hashtbl.find_opt named name with Some n -> n | None -> refuse "unknown node %s" name in
  let below parent = within ("node " ^ parent) (fun n ->
      let found = read_field "children" texts n in
      List.iter (fun child -> ignore (within "children" node child)) found;
      found) (node parent) in
  let children = let known = Hashtbl.create 16 in
    fun name -> match Hashtbl.find_opt known name with
      | Some found -> found
      | None -> let found = below name in Hashtbl.add known name found; found in
  let root = read_field "root" text v in
  ignore (within "root" node root);
  let order = in_order root children in
  let numbers = Hashtbl.create 16 in
  List.iteri (fun i name -> Hashtbl.replace numbers name i) order;
  let node_number name = Hashtbl.find_opt numbers name in
  List.iteri (fun i name ->
      if List.exists (fun child -> Hashtbl.find numbers child <= i) (children name) then
          refuse "node %s: children: there is a cycle" name) order;
  let variables = Hashtbl.create 16 in
  let rigid = numbering_in variables in
  let gate n = match read_field "gate" (optional text) n with
    | None -> Leaf | Some "or" -> Or | Some "and" -> And | Some "sand" -> Sand | Some "sand_rl" -> SandRl
    | Some "pand" -> Pand | Some "vot" -> AtLeast (read_field "threshold" number n)
    | Some other -> refuse "the gate %s is not supported" other in
  let lower = lower_of (field "lowercase" v) in
  let condition rigid = read_field "condition" (optional (guard lower rigid node_number)) in
  (* A variable of an absent event that no node observes is the event's own, of whatever name. *)
  let absence v =
    let duration = read_field "duration" (optional big) v in
    { absent = read_field "on" (call events rigid) v; absent_when = condition rigid v;
      side_of = (match read_field "side" text v, duration with
          | "during", None -> During
          | "after", Some d -> After d
          | "before", d -> Before d
          | other, _ ->
            refuse "`%s` with%s a duration is not supported" other (if duration = None then "out" else "")) } in
  let times_of v = match number v with
    | n when n >= 1 -> n
    | n -> refuse "%d is less than 1" n in
  let made name = within ("node " ^ name) (fun n ->
    let gate = gate n in
    let condition = condition rigid n in
    let on = match read_field "on" (optional (call events rigid)) n with
      | Some p -> Some p
      | None when gate = Leaf && condition = None ->
        let name = match need "name" n with Json.String points -> points | _ -> refuse "a name was expected" in
        Some (ObjectWith [ (Json.points_of "event", Exactly (Text name)) ])
      | None -> None in
    let kept = children name and times = read_field "times" times_of n in
    if (gate = Leaf) <> (kept = []) then refuse "children: a leaf has none, a gate has some";
    if List.length (List.sort_uniq compare kept) < List.length kept then refuse "children: a child stands twice";
    if gate <> Leaf && times > 1 then refuse "times: only a leaf is observed several times";
    (match gate with
     | AtLeast k when k < 1 || k > List.length kept -> refuse "threshold: %d of %d children" k (List.length kept)
     | _ -> ());
    let own name = match field name n with
      | None -> []
      | Some v -> within name (fun v ->
          if gate <> Leaf then refuse "only a leaf has values for each event";
          List.map (fun x ->
              if not (Option.fold ~none:false ~some:(fun p -> List.mem (rigid x) (pattern_variables p)) on) then
                refuse "%s does not stand in `on`" x;
              rigid x) (texts v)) v in
    { gate_of = gate; children = List.map (Hashtbl.find numbers) kept; on; times;
      when0 = condition; within = read_field "within" (optional big) n;
      kind_of = (match read_field "kind" (optional text) n with
          | None -> None | Some "fault" -> Some Fault | Some "attack" -> Some Attack
          | Some other -> refuse "unknown kind %s" other);
      distinct_values = own "distinct"; each_values = own "each";
      without = (match field "without" n with
          | None -> []
          | Some v -> within "without" (fun v -> List.map absence (items v)) v) }) (node name) in
  let ignored i = within (Printf.sprintf "ignore %d" (i + 1)) (fun v ->
      let own = numbering () in let on = read_field "on" (call events own) v in (on, condition own v)) in
  let time = optional Fun.id (need "time" v) in
  let tree = {
    nodes = List.map made order;
    top_down = (match read_field "causality" text v with "top_down" -> true | "bottom_up" -> false | other ->
        refuse "unknown causality %s" other);
    ignores = List.mapi ignored (read_field "ignores" items v);
    lateness = Option.bind time (within "time" (read_field "late" (optional big))) } in
  if not (well_formed tree) then
    refuse "the tree is not well formed: the condition of an `ignore` or `without` has a variable that no event binds";
  { tree; time; semantics = read_field "semantics" (optional text) v; numbers = node_number;
    names = order; variables; lower }
