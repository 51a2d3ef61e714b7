(** * The monitor and the certifier of texts as an OCaml program

    Natural numbers (nodes, variables, code points) become machine integers.  Integers of events,
    times and guards stay Coq's binary integers, which do not overflow. *)

Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Conditions RVAFT.Scenarios RVAFT.Monitor.
Require Import RVAFT.Plain RVAFT.Automaton RVAFT.Exploration RVAFT.Hoa RVAFT.Ltlf RVAFT.Rml RVAFT.Letters.
Require Import RVAFT.Progression RVAFT.PlainTree RVAFT.Relevance.
Require Import RVAFT.Slices RVAFT.SlicedTree RVAFT.SlicedCertificate RVAFT.SlicedLetters RVAFT.SlicedValidator.
Require Import RVAFT.BlockCertificate.
Require Import ZArith.
Require Extraction.
Require Import ExtrOcamlBasic ExtrOcamlNatInt.

(* Comparisons of integers, not those of OCaml for values of any type. *)
Extract Inlined Constant Nat.eqb => "Int.equal".
Extract Inlined Constant Nat.leb => "(fun (m : int) (n : int) -> m <= n)".
Extract Inlined Constant Nat.ltb => "(fun (m : int) (n : int) -> m < n)".

Extraction Language OCaml.
Extraction "rvaft_monitor.ml"
  well_formed basic no_absences first first_after next finish next_repeated verdict_after mark greatest
  branches has_kind
  object parse_number integer
  text_predicates same_predicate predicate_of relevance_entries sample satisfies conflict letter_of
  certify_text_rml
  clock clocked_guards slice_shapes Automaton.alphabet atoms hoa_atoms observes Conditions.bindings
    pattern_variables slice_atoms slice_predicates atom_number related_letters atoms_conflict basic_numbers
  pattern_numbers allowed
  slice_satisfies all_numbers assigned_by derivative at_end simplified hoa_step hoa_accepts
  certify_text_hoa certify_text_ltlf certify_text_block
  Z.mul Z.add Z.sub Z.opp Z.div_eucl Z.ltb Z.eqb Z.abs.
