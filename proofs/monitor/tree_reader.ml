(* A tree as `rvaft show --format json` writes it. What is not known here is refused. *)

open Rvaft_monitor

exception Refused of string

let refuse format = Printf.ksprintf (fun message -> raise (Refused message)) format

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
  | Json.Object fields -> List.fold_left (fun found (n, v) -> if n = Json.points_of name then Some v else found) None fields
  | _ -> refuse "an object was expected, with the field %s" name
let need name v = match field name v with Some found -> found | None -> refuse "the field %s is missing" name
let text v = match v with Json.String points -> Json.text_of points | _ -> refuse "a text was expected"
let items v = match v with Json.List items -> items | _ -> refuse "a list was expected"
let optional f v = match v with Json.Null -> None | _ -> Some (f v)
let number v = match v with
  | Json.Number text -> (match int_of_string_opt text with Some n -> n | None -> refuse "%s is not a small integer" text)
  | _ -> refuse "an integer was expected"
let big v = match value v with Num { mantissa; scale = N0 } -> mantissa | _ -> refuse "an integer was expected"

(* Names of variables, as numbers. *)
let numbering () =
  let known = Hashtbl.create 16 in
  fun name -> match Hashtbl.find_opt known name with
    | Some n -> n
    | None -> let n = Hashtbl.length known in Hashtbl.add known name n; n

let only v = match v with Json.Object [ (name, inner) ] -> (Json.text_of name, inner) | _ -> refuse "an object with one field was expected"

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
  let name = text (need "event" on) in
  let event = match List.find_opt (fun e -> text (need "name" e) = name) events with
    | Some e -> e | None -> refuse "unknown event type %s" name in
  let shape = need "pattern" event in
  let parameters = List.map text (items (need "parameters" event)) in
  let given = items (need "arguments" on) in
  if List.length parameters <> List.length given then refuse "event %s: wrong number of arguments" name;
  let argument index parameter a = match only a with
    | "literal", v -> Exactly (value v)
    | "variable", x -> Named (Rigid (rigid (text x)))
    | "any", _ -> if uses parameter shape > 1 then Named (Local index) else Anything
    | other, _ -> refuse "unknown argument %s" other in
  let arguments = List.mapi (fun i (p, a) -> (p, argument i p a)) (List.combine parameters given) in
  pattern rigid arguments shape

let operators = [
  "==", Equals; "!=", Differs; "<", Less; "<=", LessOrEqual; ">", Greater; ">=", GreaterOrEqual;
  "+", Add; "-", Subtract; "*", Multiply; "/", Divide; "neg", Negate; "not", Not;
  "startswith", StartsWith; "endswith", EndsWith; "contains", Contains; "like", Like;
  "abs", Absolute; "min", Minimum; "max", Maximum; "number", ToNumber ]

let rec guard lower rigid node_number g = match field "operator" g, field "point" g with
  | Some operator, _ ->
    let operands = items (need "operands" g) in
    let inner () = List.map (guard lower rigid node_number) operands in
    let rec joined make = function [ one ] -> one | one :: rest -> make one (joined make rest) | [] -> refuse "no operand" in
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
    let n = match node_number node with Some n -> n | None -> refuse "a time point of %s, which is not below the root" node in
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
   | Some _ -> refuse "the table of lower case is an object"
   | None -> ());
  fun c -> match Hashtbl.find_opt known c with
    | Some points -> points
    | None -> if table = None then refuse "`lower` needs the field lowercase" else [ c ]

type t = {
  tree : tree;
  time : (int list list * Clock.format) option;
  semantics : string option;
  numbers : string -> int option;              (* of the nodes below the root *)
  names : string list;                         (* by number *)
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

let read (v : Json.t) : t =
  (match field "format" v, field "version" v with
   | Some (Json.String f), Some (Json.Number "1") when Json.text_of f = "rvaft" -> ()
   | _ -> refuse "not a tree in JSON; write one by `rvaft show TREE --format json`");
  let nodes = items (need "nodes" v) and events = items (need "events" v) in
  let named = Hashtbl.create 16 in
  List.iter (fun n -> Hashtbl.replace named (text (need "name" n)) n) nodes;
  let node name = match Hashtbl.find_opt named name with Some n -> n | None -> refuse "unknown node %s" name in
  let children name = List.map text (items (need "children" (node name))) in
  let order = in_order (text (need "root" v)) children in
  let numbers = Hashtbl.create 16 in
  List.iteri (fun i name -> Hashtbl.replace numbers name i) order;
  let node_number name = Hashtbl.find_opt numbers name in
  let rigid = numbering () in
  let gate n = match optional text (need "gate" n) with
    | None -> Leaf | Some "or" -> Or | Some "and" -> And | Some "sand" -> Sand | Some "sand_rl" -> SandRl
    | Some "pand" -> Pand | Some "vot" -> AtLeast (number (need "threshold" n))
    | Some other -> refuse "the gate %s is not supported" other in
  let lower = lower_of (field "lowercase" v) in
  let condition rigid v = optional (guard lower rigid node_number) (need "condition" v) in
  let made name =
    let n = node name in
    let gate = gate n in
    let condition = condition rigid n in
    let on = match optional (call events rigid) (need "on" n) with
      | Some p -> Some p
      | None when gate = Leaf && condition = None ->
        let name = match need "name" n with Json.String points -> points | _ -> refuse "a name was expected" in
        Some (ObjectWith [ (Json.points_of "event", Exactly (Text name)) ])
      | None -> None in
    { gate_of = gate; children = List.map (Hashtbl.find numbers) (children name); on; times = number (need "times" n);
      when0 = condition; within = optional big (need "within" n);
      kind_of = (match optional text (need "kind" n) with
          | None -> None | Some "fault" -> Some Fault | Some "attack" -> Some Attack
          | Some other -> refuse "unknown kind %s" other) } in
  let ignore v = let own = numbering () in let on = call events own (need "on" v) in (on, condition own v) in
  let time = optional (fun t ->
      (match need "format" t with
       | Json.String f -> (List.map (function Json.String p -> p | _ -> refuse "a path of fields was expected") (items (need "field" t)),
                           Clock.format_of (Json.text_of f))
       | _ -> refuse "times in a strptime format are not supported"), optional big (need "late" t)) (need "time" v) in
  let tree = {
    nodes = List.map made order;
    top_down = (match text (need "causality" v) with "top_down" -> true | "bottom_up" -> false | other -> refuse "unknown causality %s" other);
    ignores = List.map ignore (items (need "ignores" v));
    lateness = Option.bind time snd } in
  if not (well_formed tree) then refuse "the tree is not well formed";
  { tree; time = Option.map fst time; semantics = optional text (need "semantics" v); numbers = node_number;
    names = order; lower }
