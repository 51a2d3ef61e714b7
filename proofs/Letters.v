(** * The letters that events can make

    A certificate looks at every possible letter, so it is the stronger the fewer there are.  Patterns
    that exclude each other never stand in one letter. *)

Require Import List Bool Arith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Plain RVAFT.Automaton.
Require Import RVAFT.Exploration.
Import ListNotations.

(** ** Letters without conflicts *)

(** All letters over some predicates of which no two conflict. *)
Fixpoint letters_over (conflict : nat -> nat -> bool) (predicates : list nat) : list letter :=
  match predicates with
  | [] => [[]]
  | p :: ps =>
    let l := letters_over conflict ps in
    l ++ map (cons p) (filter (forallb (fun q => negb (conflict p q))) l)
  end.

(** Of these, the letters that pass a test. *)
Definition possible_letters (conflict : nat -> nat -> bool) (plausible : letter -> bool) (predicates : list nat) :
  list letter := filter plausible (letters_over conflict predicates).

Lemma letters_over_complete : forall E (satisfies : nat -> E -> bool) conflict e,
  (forall p q, conflict p q = true -> satisfies p e = true -> satisfies q e = true -> False) ->
  forall ps, In (letter_of satisfies ps e) (letters_over conflict ps).
Proof.
  intros E satisfies conflict e C; induction ps as [| p ps IH]; simpl; auto. apply in_app_iff.
  destruct (satisfies p e) eqn:P; [right | auto]. apply in_map, filter_In. split; auto. apply forallb_forall.
  intros q I. unfold letter_of in I. apply filter_In in I as [_ I]. destruct (conflict p q) eqn:K; auto.
  exfalso; eauto.
Qed.

Theorem possible_letters_complete : forall E (satisfies : nat -> E -> bool) conflict plausible ps e,
  (forall p q, conflict p q = true -> satisfies p e = true -> satisfies q e = true -> False) ->
  plausible (letter_of satisfies ps e) = true ->
  In (letter_of satisfies ps e) (possible_letters conflict plausible ps).
Proof. intros. apply filter_In. split; auto. now apply letters_over_complete. Qed.

(** ** Patterns that exclude each other *)

(** Whether the pattern matches the value for some values of the variables, as far as one place of the
    pattern at a time can tell. *)
Fixpoint may_match (p : pattern) (v : value) : bool :=
  match p, v with
  | Exactly w, _ => value_eqb v w
  | Named _, _ | Anything, _ => true
  | ObjectWith fields, Object object =>
    forallb (fun f => match field (fst f) object with Some w => may_match (snd f) w | None => false end) fields
  | ListOf items, List list =>
    (fix all items list := match items, list with
       | p :: items, w :: list => may_match p w && all items list
       | [], [] => true
       | _, _ => false
       end) items list
  | SomeItem p, List list => existsb (may_match p) list
  | ObjectWith _, _ | ListOf _, _ | SomeItem _, _ => false
  end.

(** No value matches both. *)
Fixpoint exclude (p q : pattern) {struct p} : bool :=
  match p, q with
  | Exactly v, _ => negb (may_match q v)
  | _, Exactly v => negb (may_match p v)
  | ObjectWith fields, ObjectWith others =>
    existsb (fun f => existsb (fun g => text_eqb (fst f) (fst g) && exclude (snd f) (snd g)) others) fields
  | ObjectWith _, ListOf _ | ObjectWith _, SomeItem _ | ListOf _, ObjectWith _ | SomeItem _, ObjectWith _ => true
  | ListOf items, ListOf others =>
    (fix some items others := match items, others with
       | p :: items, q :: others => exclude p q || some items others
       | [], [] => false
       | _, _ => true
       end) items others
  | _, _ => false
  end.

Lemma matches_fields : forall b fields v, matches b (ObjectWith fields) v ->
  exists object, v = Object object /\
    forall f, In f fields -> exists w, field (fst f) object = Some w /\ matches b (snd f) w.
Proof.
  intros b fields v (object & -> & H). exists object; split; auto.
  induction fields as [| [n p] fields IH]; [intros f [] |]. destruct H as [(w & F & M) H].
  intros f [<- | I]; [exists w; auto | auto].
Qed.

Lemma may_match_complete : forall b p v, matches b p v -> may_match p v = true.
Proof.
  intros b; induction p as [w | x | | fields IH | items IH | p IH] using pattern_induction; intros v M; simpl; auto.
  - simpl in M. subst. now apply value_eqb_iff.
  - apply matches_fields in M as (object & -> & M). apply forallb_forall. intros f I. rewrite Forall_forall in IH.
    destruct (M f I) as (w & -> & K). now apply IH.
  - destruct M as (l & -> & M). revert l M. induction IH as [| p items P _ IHI]; intros [| w l] M; auto;
      try contradiction.
    destruct M as [M N]. rewrite P by exact M. now apply IHI.
  - destruct M as (l & -> & w & I & M). apply existsb_exists. eauto.
Qed.

Theorem exclude_sound : forall p q a b v, exclude p q = true -> matches a p v -> matches b q v -> False.
Proof.
  induction p as [w | x | | fields IH | items IH | p IH] using pattern_induction; intros q a b v X M N.
  - simpl in M, X. subst. apply may_match_complete in N. rewrite N in X. discriminate.
  - destruct q as [w | | | | |]; simpl in X; discriminate.
  - destruct q as [w | | | | |]; simpl in X; discriminate.
  - destruct q as [w | y | | others | others | q]; try discriminate.
    + simpl in N; subst. apply may_match_complete in M. simpl in X, M. rewrite M in X. discriminate.
    + simpl in X. apply existsb_exists in X as (f & I & X). apply existsb_exists in X as (g & J & X).
      apply andb_true_iff in X as [Q X]. apply text_eqb_iff in Q.
      apply matches_fields in M as (object & -> & M). apply matches_fields in N as (object' & Z & N).
      injection Z as <-. destruct (M f I) as (w & F & K), (N g J) as (w' & F' & K'). rewrite Q, F' in F.
      injection F as ->.
      rewrite Forall_forall in IH. eapply IH; eauto.
    + apply matches_fields in M as (object & -> & _). destruct N as (l & Z & _). discriminate.
    + apply matches_fields in M as (object & -> & _). destruct N as (l & Z & _). discriminate.
  - destruct q as [w | y | | others | others | q]; try discriminate.
    + simpl in N; subst. apply may_match_complete in M. simpl in X, M. rewrite M in X. discriminate.
    + apply matches_fields in N as (object & -> & _). destruct M as (l & Z & _). discriminate.
    + destruct M as (l & -> & M), N as (l' & Z & N). injection Z as <-. simpl in X. revert l others X M N.
      induction IH as [| p items P _ IHI]; intros [| w l] [| q others] X M N; try contradiction; try discriminate.
      destruct M as [M M'], N as [N N']. apply orb_true_iff in X as [X | X]; eauto.
  - destruct q as [w | y | | others | others | q]; try discriminate.
    + simpl in N; subst. apply may_match_complete in M. simpl in X, M. rewrite M in X. discriminate.
    + apply matches_fields in N as (object & -> & _). destruct M as (l & Z & _). discriminate.
Qed.

(** ** Patterns that others imply *)

(** A value that matches all of the patterns [s], under whatever values of the variables, matches [p].
    The test knows objects and literals. *)
Fixpoint implied (s : list pattern) (p : pattern) {struct p} : bool :=
  match p with
  | Anything => true
  | Exactly w => existsb (fun q => match q with Exactly v => value_eqb v w | _ => false end) s
  | ObjectWith fields =>
    existsb (fun q => match q with ObjectWith _ => true | _ => false end) s &&
    forallb (fun f =>
      let inner := flat_map (fun q => match q with
        | ObjectWith others => map snd (filter (fun g => text_eqb (fst g) (fst f)) others)
        | _ => []
        end) s in
      negb (is_nil inner) && implied inner (snd f)) fields
  | Named _ | ListOf _ | SomeItem _ => false
  end.

Lemma fields_match : forall b fields object,
  (forall f, In f fields -> exists w, field (fst f) object = Some w /\ matches b (snd f) w) ->
  matches b (ObjectWith fields) (Object object).
Proof.
  intros b fields object H. exists object; split; auto. induction fields as [| [n p] fields IH]; auto.
  split; [apply (H (n, p)); simpl; auto |]. apply IH. intros f I. apply H; simpl; auto.
Qed.

Theorem implied_sound : forall p s b v, implied s p = true -> (forall q, In q s -> exists a, matches a q v) ->
  matches b p v.
Proof.
  induction p as [w | x | | fields IH | items IH | p IH] using pattern_induction; intros s b v I M; simpl in I;
    try discriminate.
  - apply existsb_exists in I as (q & I & E). destruct (M q I) as (a & K). destruct q; try discriminate.
    apply value_eqb_iff in E. simpl in *. congruence.
  - exact Logic.I.
  - apply andb_true_iff in I as [O I]. apply existsb_exists in O as (q & J & O).
    destruct (M q J) as (a & K). destruct q as [| | | others | |]; try discriminate.
    apply matches_fields in K as (object & -> & _). apply fields_match. intros f F.
    rewrite forallb_forall in I. specialize (I f F). apply andb_true_iff in I as [NN I].
    set (inner := flat_map _ s) in *.
    assert (IN : forall q, In q inner -> exists w a, field (fst f) object = Some w /\ matches a q w).
    { intros q Q. apply in_flat_map in Q as (q' & Q' & Q). destruct q' as [| | | gs | |]; try (destruct Q; fail).
      apply in_map_iff in Q as (g & <- & Q). apply filter_In in Q as [Q E]. apply text_eqb_iff in E.
      destruct (M _ Q') as (a' & K'). apply matches_fields in K' as (object' & Z & K'). injection Z as <-.
      destruct (K' g Q) as (w & W & N). rewrite E in W. eauto. }
    destruct inner as [| q0 l] eqn:L; [discriminate |].
    destruct (IN q0) as (w & a0 & W & _); [simpl; auto |]. exists w; split; auto.
    rewrite Forall_forall in IH. apply (IH f F (q0 :: l)); auto. intros q Q.
    destruct (IN q Q) as (w' & a' & W' & N). rewrite W in W'. injection W' as <-. eauto.
Qed.
