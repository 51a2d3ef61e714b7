(** * The monitor as an OCaml program

    Natural numbers (nodes, variables, code points) become machine integers.  Integers of events,
    times and guards stay Coq's binary integers, which do not overflow. *)

Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Monitor.
Require Import ZArith.
Require Extraction.
Require Import ExtrOcamlBasic ExtrOcamlNatInt.

(* Comparisons of integers, not those of OCaml for values of any type. *)
Extract Inlined Constant Nat.eqb => "Int.equal".
Extract Inlined Constant Nat.leb => "(fun (m : int) (n : int) -> m <= n)".
Extract Inlined Constant Nat.ltb => "(fun (m : int) (n : int) -> m < n)".

Extraction Language OCaml.
Extraction "rvaft_monitor.ml"
  well_formed first next next_repeated verdict_after mark greatest
  object parse_number integer
  Z.mul Z.add Z.sub Z.opp Z.div_eucl Z.ltb Z.eqb Z.abs.
