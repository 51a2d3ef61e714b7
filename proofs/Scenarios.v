(** * The scenarios of a tree, enumerated

    [plans t w] computes the feasible scenarios of the selection [w] of the tree [t].
    [plans_sound] and [plans_complete] say that these are the scenarios of the definition. *)

Require Import List Bool Arith ZArith Lia Permutation.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions.
Import ListNotations.

(** ** Well-formed trees *)

Record WellFormed (t : tree) : Prop := {
  has_root : 0 < length (nodes t);
  children_below : forall n c, n < length (nodes t) -> In c (children (node_at t n)) -> n < c < length (nodes t);
  own_variables : forall p g, In (p, Some g) (ignores t) -> incl (variables g) (pattern_variables p);
  absence_bound : forall n c x, In c (without (node_at t n)) -> In x (absence_variables c) ->
    In x (pattern_variables (absent c)) \/ shared t x = true }.

Lemma combine_seq : forall A (l : list A) d i n x,
  In (n, x) (combine (seq i (length l)) l) <-> i <= n < i + length l /\ x = nth (n - i) l d.
Proof.
  induction l as [| y l IH]; simpl; intros d i n x; [lia |]. rewrite (IH d). split.
  - intros [Q | [L ->]].
    + injection Q; intros; subst. rewrite Nat.sub_diag. split; [lia | auto].
    + split; [lia |]. replace (n - i) with (S (n - S i)) by lia. auto.
  - intros [L E]. destruct (Nat.eq_dec i n) as [-> | N].
    + rewrite Nat.sub_diag in E; subst; auto.
    + right. split; [lia |]. replace (n - i) with (S (n - S i)) in E by lia. auto.
Qed.

Lemma well_formed_iff : forall t, well_formed t = true <-> WellFormed t.
Proof.
  intros t; unfold well_formed. rewrite !andb_true_iff, Nat.ltb_lt, !forallb_forall.
  assert (V : (forall i, In i (ignores t) -> match snd i with
      | Some g => forallb (fun x => existsb (Nat.eqb x) (pattern_variables (fst i))) (variables g) = true
      | None => true = true end) <->
    forall p g, In (p, Some g) (ignores t) -> incl (variables g) (pattern_variables p)).
  { split.
    - intros H p g I x X. specialize (H _ I). simpl in H. rewrite forallb_forall in H. now apply member_iff, H.
    - intros H [p [g |]] I; simpl; auto. apply forallb_forall. intros x X. apply member_iff. eapply H; eauto. }
  assert (A : (forall d, In d (nodes t) -> forallb (fun c =>
      forallb (fun x => existsb (Nat.eqb x) (pattern_variables (absent c)) || shared t x) (absence_variables c))
      (without d) = true) <->
    forall n c x, In c (without (node_at t n)) -> In x (absence_variables c) ->
      In x (pattern_variables (absent c)) \/ shared t x = true).
  { split.
    - intros H n c x I J.
      assert (B := all_nodes t (fun d => forallb (fun c => forallb (fun x =>
        existsb (Nat.eqb x) (pattern_variables (absent c)) || shared t x) (absence_variables c)) (without d)) eq_refl
        (proj2 (forallb_forall _ _) H) n).
      simpl in B. rewrite forallb_forall in B. specialize (B c I). rewrite forallb_forall in B. specialize (B x J).
      apply orb_true_iff in B as [B | B]; auto. left. now apply member_iff.
    - intros H d I. apply forallb_forall. intros c J. apply forallb_forall. intros x X. apply orb_true_iff.
      apply (In_nth _ _ nowhere) in I as (n & _ & <-). destruct (H n c x J X) as [Y | Y]; auto. left.
      now apply member_iff. }
  split; [intros [[[L F] O] B]; constructor; auto; [| | now apply A] |
    intros [L F O B]; split; [split; [split; auto |] | now apply A]].
  2:{ apply V. intros [p g] I. specialize (O (p, g) I). simpl in *. destruct g; auto. }
  3:{ intros [p g] I. assert (X := proj2 V O (p, g) I). simpl in *. destruct g; auto. }
  - intros n c I J. specialize (F (n, node_at t n)).
    rewrite (combine_seq node (nodes t) nowhere), Nat.sub_0_r in F. simpl in F.
    assert (F' : forallb (fun c => (n <? c) && (c <? length (nodes t))) (children (node_at t n)) = true)
      by (apply F; split; [lia | reflexivity]).
    rewrite forallb_forall in F'. apply F' in J. apply andb_true_iff in J as [Y Z].
    apply Nat.ltb_lt in Y, Z; lia.
  - intros [n d] I. apply (combine_seq _ _ nowhere) in I as [I ->]. rewrite Nat.sub_0_r in *. simpl.
    apply forallb_forall. intros c J. apply andb_true_iff; split; apply Nat.ltb_lt; apply (F n c); auto; lia.
Qed.

(** ** Increasing lists *)

Lemma increasing_ge : forall l i x, Increasing i l -> In x l -> i <= x.
Proof.
  induction l; simpl; intros i x H I; [tauto |]. destruct H as [H K], I as [<- | I]; auto.
  apply (IHl _ _ K) in I. lia.
Qed.

Lemma increasing_le : forall l i j, Increasing i l -> j <= i -> Increasing j l.
Proof. destruct l; simpl; intros; auto. intuition lia. Qed.

Lemma increasing_NoDup : forall l i, Increasing i l -> NoDup l.
Proof.
  induction l; simpl; intros i H; constructor; [| destruct H; eauto].
  intros I. destruct H as [_ H]. apply (increasing_ge _ _ _ H) in I. lia.
Qed.

(** ** Resolutions *)

Section Resolve.
Variable choices : node -> list (list nat).
Variable Chosen : node -> list nat -> Prop.
Hypothesis choices_iff : forall d kept, In kept (choices d) <-> Chosen d kept.
Hypothesis chosen_children : forall d kept c, Chosen d kept -> In c kept -> In c (children d).

(** The choices for the nodes [ns], the first of which has the number [i]; [reached] has the nodes
    that earlier choices reach. *)
Fixpoint resolve (ns : list node) (i : nat) (reached : list nat) : list resolution :=
  match ns with
  | [] => [[]]
  | d :: ns =>
    if member i reached
    then flat_map (fun kept => map (cons (i, kept)) (resolve ns (S i) (kept ++ reached))) (choices d)
    else resolve ns (S i) reached
  end.

Definition Chooses (t : tree) (r : resolution) : Prop :=
  Increasing 0 (map fst r) /\
  (forall n kept, In (n, kept) r -> Chosen (node_at t n) kept) /\
  (forall n, In n (map fst r) <-> Reached r 0 n /\ n < length (nodes t)).

(** What [resolve] computes: a node is there when it is reached at the beginning, or by a choice. *)
Definition Local (ns : list node) (i : nat) (reached : list nat) (r : resolution) : Prop :=
  Increasing i (map fst r) /\
  (forall n kept, In (n, kept) r -> Chosen (nth (n - i) ns nowhere) kept) /\
  (forall n, In n (map fst r) <->
     i <= n < i + length ns /\ (In n reached \/ exists m kept, In (m, kept) r /\ In n kept)).

Lemma in_keys : forall (r : resolution) n kept, In (n, kept) r -> In n (map fst r).
Proof. intros r n kept I. apply in_map_iff. exists (n, kept); auto. Qed.

Lemma resolve_iff : forall ns i reached r,
  (forall n c, n < length ns -> In c (children (nth n ns nowhere)) -> i + n < c) ->
  (In r (resolve ns i reached) <-> Local ns i reached r).
Proof.
  induction ns as [| d ns IH]; intros i reached r W.
  - unfold Local; simpl. split.
    + intros [<- | []]; simpl. split; [auto | split; [intros ? ? [] |]].
      intros n; split; [intros [] | intros [? _]; lia].
    + intros (_ & _ & H). destruct r as [| [m kept] r]; auto. exfalso.
      assert (i <= m < i + 0) by (apply H; simpl; auto). lia.
  - assert (W' : forall n c, n < length ns -> In c (children (nth n ns nowhere)) -> S i + n < c).
    { intros n c L I. apply (W (S n) c) in I; simpl; lia. }
    assert (UP : forall r, Local (d :: ns) i reached r -> forall m kept c, In (m, kept) r -> In c kept -> m < c).
    { intros r0 (_ & L & K) m kept c I J. apply (chosen_children _ _ _ (L _ _ I)) in J.
      assert (B := in_keys _ _ _ I). apply K in B as [B _]. simpl in B.
      apply (W (m - i) c) in J; simpl; lia. }
    cbn [resolve]. destruct (member i reached) eqn:M.
    + apply member_iff in M. rewrite in_flat_map. split.
      * intros (kept & C & I). apply choices_iff in C. apply in_map_iff in I as (r' & <- & I).
        apply IH in I; auto. destruct I as (A & B & L). split; [| split]; simpl.
        -- split; auto.
        -- intros m k [Q | I].
           ++ injection Q; intros; subst. now rewrite Nat.sub_diag.
           ++ assert (S i <= m) by (apply (increasing_ge _ _ _ A); now apply in_keys in I).
              replace (m - i) with (S (m - S i)) by lia. auto.
        -- intros m. rewrite L. split.
           ++ intros [-> | [Q R]]; [split; [lia | auto] |]. split; [lia |].
              destruct R as [R | (p & k & I & J)]; [| right; exists p, k; auto].
              apply in_app_iff in R as [R | R]; auto. right; exists i, kept; auto.
           ++ intros [Q R]. destruct (Nat.eq_dec i m); auto. right. split; [lia |].
              destruct R as [R | (p & k & [X | I] & J)]; [left; apply in_app_iff; auto | | right; eauto].
              injection X; intros; subst. left; apply in_app_iff; auto.
      * intros H. assert (U := UP r H). destruct H as (A & B & L).
        assert (I : In i (map fst r)) by (apply L; split; [simpl; lia | auto]).
        destruct r as [| [j kept] r']; [destruct I |]. simpl in A, I. destruct A as [A1 A2].
        assert (j = i) as ->. { destruct I as [-> | I]; auto. apply (increasing_ge _ _ _ A2) in I. lia. }
        assert (C := B i kept (or_introl eq_refl)). rewrite Nat.sub_diag in C; simpl in C.
        exists kept. split; [now apply choices_iff |]. apply in_map. apply IH; auto. split; [auto | split].
        -- intros m k J. assert (D := B m k (or_intror J)).
           assert (S i <= m) by (apply (increasing_ge _ _ _ A2); now apply in_keys in J).
           replace (m - i) with (S (m - S i)) in D by lia. auto.
        -- intros m. specialize (L m). simpl in L. split.
           ++ intros J. assert (S i <= m) by now apply (increasing_ge _ _ _ A2).
              destruct L as [L _]. destruct (L (or_intror J)) as [R S]. split; [lia |].
              destruct S as [S | (p & k & [X | K] & Y)]; [left; apply in_app_iff; auto | | right; eauto].
              injection X; intros; subst. left; apply in_app_iff; auto.
           ++ intros [R S]. destruct L as [_ L]. destruct L as [Z | Z]; auto; [| lia]. split; [lia |].
              destruct S as [S | (p & k & K & Y)]; [| right; eauto].
              apply in_app_iff in S as [S | S]; auto. right; exists i, kept; auto.
    + assert (NI : ~ In i reached) by (rewrite <- member_iff; congruence).
      rewrite IH by auto. split.
      * intros (A & B & L). split; [| split].
        -- eapply increasing_le; eauto.
        -- intros m k I. assert (S i <= m) by (apply (increasing_ge _ _ _ A); now apply in_keys in I).
           replace (m - i) with (S (m - S i)) by lia. simpl. auto.
        -- intros m. rewrite L. simpl. split; [intros [Q R]; split; [lia | auto] |]. intros [Q R].
           destruct (Nat.eq_dec i m); [| split; [lia | auto]]. exfalso. subst m.
           destruct R as [R | (p & k & I & J)]; auto.
           assert (P := in_keys _ _ _ I). apply L in P as [P _].
           assert (D := B _ _ I). apply (chosen_children _ _ _ D) in J.
           apply (W' (p - S i) i) in J; lia.
      * intros H. assert (U := UP r H). destruct H as (A & B & L).
        assert (NK : ~ In i (map fst r)).
        { intros I. assert (J := I). apply L in J as [_ [J | (p & k & J & K)]]; auto. assert (p < i) by eauto.
          assert (i <= p) by (apply (increasing_ge _ _ _ A); now apply in_keys in J). lia. }
        assert (A2 : Increasing (S i) (map fst r)).
        { destruct (map fst r) as [| x l]; simpl in *; auto. destruct A. split; auto.
          destruct (Nat.eq_dec i x); [subst; tauto | lia]. }
        split; [auto | split].
        -- intros m k J. assert (D := B m k J).
           assert (S i <= m) by (apply (increasing_ge _ _ _ A2); now apply in_keys in J).
           replace (m - i) with (S (m - S i)) in D by lia. auto.
        -- intros m. rewrite L. simpl. split; [| intros [Q R]; split; [lia | auto]]. intros [Q R].
           split; auto. destruct (Nat.eq_dec i m); [subst; exfalso; apply NK, L; simpl; auto | lia].
Qed.

Theorem resolve_complete : forall t r, WellFormed t -> (In r (resolve (nodes t) 0 [0]) <-> Chooses t r).
Proof.
  intros t r [T W _ _]. rewrite resolve_iff by (intros n c L I; simpl; apply (W n c); auto).
  unfold Local, Chooses. simpl.
  assert (B0 : (forall n kept, In (n, kept) r -> Chosen (nth (n - 0) (nodes t) nowhere) kept) <->
     (forall n kept, In (n, kept) r -> Chosen (node_at t n) kept)).
  { unfold node_at. split; intros B n kept I; specialize (B n kept I); now rewrite Nat.sub_0_r in *. }
  rewrite B0; clear B0.
  split; intros (A & B & L); (split; [auto | split; [auto |]]).
  - assert (UP : forall m kept c, In (m, kept) r -> In c kept -> m < c < length (nodes t)).
    { intros m kept c I J. apply W; [apply L, (in_keys _ _ _ I) |]. eapply chosen_children; eauto. }
    intros n. split.
    + induction n as [n IHn] using lt_wf_ind. intros I. apply L in I as [Q [[<- | []] | (m & kept & I & J)]];
        [split; [constructor | lia] |]. assert (X := UP _ _ _ I J). split; [| lia].
      econstructor; eauto. apply IHn; [lia | now apply in_keys in I].
    + intros [R Q]. apply L. split; [lia |]. destruct R; [auto | right; eauto].
  - assert (UP : forall m kept c, In (m, kept) r -> In c kept -> m < c < length (nodes t)).
    { intros m kept c I J. apply W; [apply L, (in_keys _ _ _ I) |]. eapply chosen_children; eauto. }
    intros n. rewrite L. split.
    + intros [R Q]. split; [lia |]. destruct R; [auto | right; eauto].
    + intros [Q [[<- | []] | (m & kept & I & J)]]; [split; [constructor | lia] |].
      split; [| lia]. econstructor; eauto. apply L. now apply in_keys in I.
Qed.
End Resolve.

(** ** The choices of gates *)

Fixpoint sublists {A} (l : list A) : list (list A) :=
  match l with
  | [] => [[]]
  | x :: l => let rest := sublists l in map (cons x) rest ++ rest
  end.

Lemma sublists_iff : forall A (l s : list A), In s (sublists l) <-> Sublist s l.
Proof.
  induction l as [| x l IH]; simpl; intros s.
  - split; [intros [<- | []]; constructor | intros H; inversion H; auto].
  - rewrite in_app_iff, in_map_iff, IH. split.
    + intros [(r & <- & I) | I]; [constructor; now apply IH | now constructor].
    + intros H; inversion H; subst; auto. left. eexists; split; eauto. now apply IH.
Qed.

Lemma sublist_in : forall A (s l : list A) x, Sublist s l -> In x s -> In x l.
Proof. induction 1; simpl; intuition. Qed.

Definition choices (d : node) : list (list nat) :=
  match gate_of d with
  | Or => map (fun c => [c]) (children d)
  | AtLeast k => filter (fun kept => k <=? length kept) (sublists (children d))
  | Leaf | And | Sand | SandRl | Pand => [children d]
  end.

Definition branch_choices (d : node) : list (list nat) :=
  match gate_of d with
  | Or => map (fun c => [c]) (children d)
  | Leaf | And | Sand | SandRl | Pand | AtLeast _ => [children d]
  end.

Lemma choices_iff : forall d kept, In kept (choices d) <-> Choice d kept.
Proof.
  intros d kept; unfold choices, Choice. destruct (gate_of d); simpl;
    try (split; [intros [<- | []]; auto | intros ->; auto]).
  - rewrite in_map_iff. split; [intros (c & <- & I) | intros (c & I & ->)]; eauto.
  - rewrite filter_In, sublists_iff, Nat.leb_le. tauto.
Qed.

Lemma branch_choices_iff : forall d kept, In kept (branch_choices d) <-> BranchChoice d kept.
Proof.
  intros d kept; unfold branch_choices, BranchChoice. destruct (gate_of d); simpl;
    try (split; [intros [<- | []]; auto | intros ->; auto]).
  rewrite in_map_iff. split; [intros (c & <- & I) | intros (c & I & ->)]; eauto.
Qed.

Lemma choice_children : forall d kept c, Choice d kept -> In c kept -> In c (children d).
Proof.
  unfold Choice; intros d kept c H I; destruct (gate_of d); subst; auto.
  - destruct H as (e & J & ->). destruct I as [<- | []]; auto.
  - destruct H. eapply sublist_in; eauto.
Qed.

Lemma branch_choice_children : forall d kept c, BranchChoice d kept -> In c kept -> In c (children d).
Proof.
  unfold BranchChoice; intros d kept c H I; destruct (gate_of d); subst; auto.
  destruct H as (e & J & ->). destruct I as [<- | []]; auto.
Qed.

Definition resolutions (t : tree) : list resolution := resolve choices (nodes t) 0 [0].
Definition branches (t : tree) : list resolution := resolve branch_choices (nodes t) 0 [0].

Theorem resolutions_iff : forall t r, WellFormed t -> (In r (resolutions t) <-> Resolution t r).
Proof. intros. apply (resolve_complete choices Choice choices_iff choice_children); auto. Qed.

Theorem branches_iff : forall t b, WellFormed t -> (In b (branches t) <-> Branch t b).
Proof. intros. apply (resolve_complete branch_choices BranchChoice branch_choices_iff branch_choice_children); auto.
Qed.

(** ** Parts *)

(** The nodes that a node reaches; [r] has its nodes in increasing order. *)
Definition reach (r : resolution) (n : nat) : list nat :=
  fold_left (fun found x => if member (fst x) found then snd x ++ found else found) r [n].

Lemma fold_reach : forall r i found x, Increasing i (map fst r) -> (forall n kept c, In (n, kept) r ->
  In c kept -> n < c) ->
  (In x (fold_left (fun found x => if member (fst x) found then snd x ++ found else found) r found) <->
   exists a, In a found /\ Reached r a x).
Proof.
  induction r as [| [n kept] r IH]; intros i found x A U.
  - simpl. split; [intros I; exists x; split; auto; constructor |]. intros (a & I & R). induction R; auto. destruct H.
  - simpl in A. destruct A as [A1 A2].
    assert (MONO : forall a y, Reached r a y -> Reached ((n, kept) :: r) a y).
    { induction 1; [constructor | econstructor; simpl; eauto]. }
    assert (BACK : forall a y, Reached ((n, kept) :: r) a y ->
      Reached r a y \/ (a = n /\ exists c, In c kept /\ Reached r c y)).
    { induction 1 as [| m k y R IR I J]; [left; constructor |]. destruct I as [Q | I].
      - injection Q; intros; subst. destruct IR as [IR | (_ & d & D & IR)].
        + inversion IR as [| p e ? IP K L]; subst; [right; split; auto; exists y; split; auto; constructor |].
          exfalso. assert (S m <= p) by (apply (increasing_ge _ _ _ A2); now apply in_keys in K).
          assert (p < m) by (apply (U p e); simpl; auto). lia.
        + exfalso. assert (m < d) by (apply (U m k); simpl; auto).
          assert (m < m); [| lia]. clear - IR H U A2.
          assert (G : forall y, Reached r d y -> m < y).
          { induction 1 as [| a b e A' IHa B' C']; auto. assert (a < e) by (apply (U a b); simpl; auto). lia. }
          now apply G.
      - destruct IR as [IR | (-> & d & D & IR)]; [left; econstructor; eauto |].
        right; split; auto; exists d; split; auto; econstructor; eauto. }
    cbn [fold_left fst snd]. rewrite (IH (S n)) by (auto; intros; eapply U; simpl; eauto).
    destruct (member n found) eqn:M.
    + apply member_iff in M. split.
      * intros (a & I & R). apply in_app_iff in I as [I | I]; [| eauto].
        exists n; split; auto. clear - I R MONO.
        induction R; [econstructor; [constructor | simpl; eauto | auto] | econstructor; [exact IHR | simpl;
          eauto | auto]].
      * intros (a & I & R). apply BACK in R as [R | (-> & c & C & R)].
        -- exists a; split; auto. apply in_app_iff; auto.
        -- exists c; split; auto. apply in_app_iff; auto.
    + assert (NI : ~ In n found) by (rewrite <- member_iff; congruence). split.
      * intros (a & I & R); eauto.
      * intros (a & I & R). apply BACK in R as [R | (-> & _)]; [eauto | contradiction].
Qed.

Lemma resolution_up : forall t r, WellFormed t -> Resolution t r ->
  forall n kept c, In (n, kept) r -> In c kept -> n < c < length (nodes t).
Proof.
  intros t r [_ W _ _] (A & B & L) n kept c I J. apply W; [apply L, (in_keys _ _ _ I) |].
  eapply choice_children; eauto.
Qed.

Lemma reach_iff : forall t r n x, WellFormed t -> Resolution t r -> (In x (reach r n) <-> Reached r n x).
Proof.
  intros t r n x W R. unfold reach. rewrite (fold_reach r 0).
  - split; [intros (a & [<- | []] & H); auto | intros H; exists n; simpl; auto].
  - apply R.
  - intros m kept c I J. now destruct (resolution_up t r W R m kept c I J).
Qed.

Definition occurs_at (t : tree) (n : nat) : list occurrence :=
  match on (node_at t n) with Some _ => map (pair n) (seq 0 (times (node_at t n))) | None => [] end.

Definition occurrences_of (t : tree) (r : resolution) : list occurrence := flat_map (occurs_at t) (map fst r).

Lemma occurrences_iff : forall t r o, In o (occurrences_of t r) <-> Occurs t r o.
Proof.
  intros t r [n i]; unfold occurrences_of, Occurs, occurs_at. rewrite in_flat_map. simpl. split.
  - intros (m & I & J). destruct (on (node_at t m)) eqn:O; [| destruct J].
    apply in_map_iff in J as (j & Q & J). injection Q; intros; subst. apply in_seq in J.
    rewrite O. repeat split; auto; [congruence | lia].
  - intros (I & O & L). exists n; split; auto. destruct (on (node_at t n)); [| congruence].
    apply in_map, in_seq; lia.
Qed.

Definition part_at (t : tree) (r : resolution) (n : nat) : list occurrence :=
  if member n (map fst r)
  then let below := reach r n in flat_map (fun m => if member m below then occurs_at t m else []) (map fst r)
  else [].

Lemma part_at_iff : forall t r n o, WellFormed t -> Resolution t r -> (In o (part_at t r n) <-> InPart t r n o).
Proof.
  intros t r n o W R. unfold part_at, InPart. rewrite <- occurrences_iff. unfold occurrences_of.
  assert (H : forall m, In o (occurs_at t m) -> fst o = m).
  { intros m I. unfold occurs_at in I. destruct (on (node_at t m)); [| destruct I].
    apply in_map_iff in I as (j & <- & _); auto. }
  destruct (member n (map fst r)) eqn:M.
  - rewrite !in_flat_map. split.
    + intros (m & I & J). destruct (member m (reach r n)) eqn:B; [| destruct J]. split; [eauto |].
      apply member_iff, (reach_iff t r n m W R) in B. now rewrite (H m J).
    + intros [(m & I & J) B]. exists m; split; auto. rewrite <- (H m J).
      replace (member (fst o) (reach r n)) with true; [now rewrite (H m J) |].
      symmetry. now apply member_iff, (reach_iff t r n).
  - split; [intros [] |]. intros [I B]. exfalso. apply in_flat_map in I as (m & I & J). apply H in J; subst.
    assert (N : ~ In n (map fst r)) by (rewrite <- member_iff; congruence).
    assert (UP : forall x, Reached r n x -> In x (map fst r) -> In n (map fst r)).
    { induction 1 as [| k kept c B' IB K L]; auto. intros _. apply IB. now apply in_keys in K. }
    now apply N, (UP (fst o)).
Qed.

(** The parts of the nodes, computed once. *)
Definition parts (t : tree) (r : resolution) : nat -> list occurrence :=
  let table := map (fun n => (n, part_at t r n)) (map fst r) in
  fun n => match find (fun entry => fst entry =? n) table with Some entry => snd entry | None => [] end.

Lemma parts_at : forall t r n, parts t r n = part_at t r n.
Proof.
  intros t r n; unfold parts. destruct (find _ _) as [[m p] |] eqn:F.
  - apply find_some in F as [I Q]. simpl in Q; apply Nat.eqb_eq in Q; subst.
    apply in_map_iff in I as (k & Q & _). now injection Q; intros; subst.
  - unfold part_at. destruct (member n (map fst r)) eqn:M; auto. exfalso.
    apply member_iff in M. assert (I := in_map (fun n => (n, part_at t r n)) _ _ M).
    apply (find_none _ _ F) in I. simpl in I. now rewrite Nat.eqb_refl in I.
Qed.

Lemma parts_iff : forall t r, WellFormed t -> Resolution t r -> forall n o, In o (parts t r n) <-> InPart t r n o.
Proof. intros. rewrite parts_at. now apply part_at_iff. Qed.

(** ** Precedence *)

(** The pairs of an earlier and a later element of a list. *)
Fixpoint in_turn {A} (l : list A) : list (A * A) :=
  match l with [] => [] | x :: l => map (pair x) l ++ in_turn l end.

Lemma in_turn_iff : forall A (l : list A) c d, In (c, d) (in_turn l) <-> Earlier l c d.
Proof.
  induction l as [| x l IH]; simpl; intros c d.
  - split; [intros [] | intros H; inversion H].
  - rewrite in_app_iff, in_map_iff, IH. split.
    + intros [(y & Q & I) | H]; [injection Q; intros; subst; now constructor | now apply earlier_there].
    + intros H; inversion H; subst; eauto.
Qed.

Lemma earlier_in : forall A (l : list A) c d, Earlier l c d -> In c l /\ In d l.
Proof. induction 1; simpl; intuition. Qed.

(** The nodes of which one comes before the other by causality or sequence. *)
Definition node_pairs (t : tree) (r : resolution) : list (nat * nat) :=
  flat_map (fun x : nat * list nat => let (n, kept) := x in
    let below := filter (fun m => negb (m =? n)) (reach r n) in
    let crossed := fun y : nat * nat => list_prod (reach r (fst y)) (reach r (snd y)) in
    (if top_down t then map (fun m => (n, m)) below else map (fun m => (m, n)) below) ++
    match gate_of (node_at t n) with
    | Sand => flat_map crossed (in_turn kept)
    | SandRl => flat_map crossed (map (fun y => (snd y, fst y)) (in_turn kept))
    | _ => []
    end) r.

(** The gates [pand] with their children that have occurrences. *)
Definition slots (t : tree) (r : resolution) : list (nat * list nat) :=
  flat_map (fun x : nat * list nat => let (n, kept) := x in
    match gate_of (node_at t n) with
    | Pand => [(n, filter (fun c => negb (is_nil (parts t r c))) kept)]
    | _ => []
    end) r.

Fixpoint product {A} (l : list (list A)) : list (list A) :=
  match l with [] => [[]] | options :: l => flat_map (fun x => map (cons x) (product l)) options end.

Lemma product_iff : forall A (l : list (list A)) x, In x (product l) <-> Forall2 (fun y options => In y options) x l.
Proof.
  induction l as [| options l IH]; simpl; intros x.
  - split; [intros [<- | []]; constructor | intros H; inversion H; auto].
  - rewrite in_flat_map. split.
    + intros (y & I & J). apply in_map_iff in J as (z & <- & J). constructor; auto. now apply IH.
    + intros H; inversion H as [| y options' z l' I J]; subst. exists y; split; auto. apply in_map, IH; auto.
Qed.

Definition chosen_last := list (nat * nat * occurrence).

Definition last_in (chosen : chosen_last) (n c : nat) : occurrence :=
  match find (fun x => (fst (fst x) =? n) && (snd (fst x) =? c)) chosen with Some x => snd x | None => (0, 0) end.

(** The ways in which the parts below the gates [pand] can end. *)
Definition lasts (t : tree) (r : resolution) : list chosen_last :=
  product (flat_map (fun slot => map (fun c => map (fun o => (fst slot, c, o)) (parts t r c)) (snd slot)) (slots t r)).

Definition end_pairs (t : tree) (r : resolution) (last : nat -> nat -> occurrence) : list (occurrence * occurrence) :=
  flat_map (fun slot => let (n, kept) := (slot : nat * list nat) in
    flat_map (fun c => let l := last n c in map (fun o => (o,
      l)) (filter (fun o => negb (same o l)) (parts t r c))) kept ++
    map (fun y => (last n (fst y), last n (snd y))) (in_turn kept)) (slots t r).

Definition precedes (ordered : list (nat * nat)) (ends : list (occurrence * occurrence)) (p o : occurrence) : bool :=
  ((fst p =? fst o) && (snd p <? snd o)) ||
  existsb (fun x => (fst x =? fst p) && (snd x =? fst o)) ordered ||
  existsb (fun x => same (fst x) p && same (snd x) o) ends.

Section Precedence.
Variable t : tree.
Variable r : resolution.
Hypothesis W : WellFormed t.
Hypothesis R : Resolution t r.

Lemma node_pairs_iff : forall n m, In (n, m) (node_pairs t r) <->
  exists k kept, In (k, kept) r /\
   ((top_down t = true /\ n = k /\ m <> k /\ Reached r k m) \/
    (top_down t = false /\ m = k /\ n <> k /\ Reached r k n) \/
    (gate_of (node_at t k) = Sand /\ exists c d, Earlier kept c d /\ Reached r c n /\ Reached r d m) \/
    (gate_of (node_at t k) = SandRl /\ exists c d, Earlier kept c d /\ Reached r d n /\ Reached r c m)).
Proof.
  intros n m; unfold node_pairs. rewrite in_flat_map.
  assert (PA := fun c x => reach_iff t r c x W R).
  assert (B : forall k x, In x (filter (fun m => negb (m =? k)) (reach r k)) <-> x <> k /\ Reached r k x).
  { intros k x. rewrite filter_In, PA, negb_true_iff, Nat.eqb_neq. tauto. }
  assert (S : forall l, In (n, m) (flat_map (fun y : nat * nat => list_prod (reach r (fst y)) (reach r (snd y))) l) <->
    exists c d, In (c, d) l /\ Reached r c n /\ Reached r d m).
  { intros l. rewrite in_flat_map. split.
    - intros ([c d] & I & J). apply in_prod_iff in J as [J K]. apply PA in J, K. exists c, d; auto.
    - intros (c & d & I & J & K). exists (c, d); split; auto. apply in_prod_iff. simpl. rewrite !PA. auto. }
  split.
  - intros ([k kept] & I & H). exists k, kept; split; auto. apply in_app_iff in H as [H | H].
    + destruct (top_down t); apply in_map_iff in H as (x & Q & H); injection Q; intros; subst; apply B in H; tauto.
    + destruct (gate_of (node_at t k)); try destruct H.
      * apply S in H as (c & d & E & H). apply in_turn_iff in E. right; right; left; split; eauto.
      * apply S in H as (c & d & E & H). apply in_map_iff in E as ([x y] & Q & E). injection Q; intros; subst.
        apply in_turn_iff in E. right; right; right; split; auto. exists d, c; auto.
  - intros (k & kept & I & H). exists (k, kept); split; auto. apply in_app_iff.
    destruct H as [(T & -> & N & H) | [(T & -> & N & H) | [(G & c & d & E & H & K) | (G & c & d & E & H & K)]]].
    + left. rewrite T. apply in_map_iff. exists m; split; auto. now apply B.
    + left. rewrite T. apply in_map_iff. exists n; split; auto. now apply B.
    + right. rewrite G. apply S. exists c, d; split; auto. now apply in_turn_iff.
    + right. rewrite G. apply S. exists d, c; split; auto. apply in_map_iff. exists (c, d); split; auto.
      now apply in_turn_iff.
Qed.

Lemma slots_iff : forall n kept, In (n, kept) (slots t r) <->
  exists all, In (n, all) r /\ gate_of (node_at t n) = Pand /\
    kept = filter (fun c => negb (is_nil (parts t r c))) all.
Proof.
  intros n kept; unfold slots. rewrite in_flat_map. split.
  - intros ([k all] & I & H). destruct (gate_of (node_at t k)) eqn:G; simpl in H; try tauto.
    destruct H as [H | []]. injection H; intros; subst. exists all; auto.
  - intros (all & I & G & ->). exists (n, all); split; auto. rewrite G. simpl; auto.
Qed.

Lemma part_filled : forall c, negb (is_nil (parts t r c)) = true <-> exists o, InPart t r c o.
Proof.
  intros c. assert (P := parts_iff t r W R c). destruct (parts t r c) as [| o l]; simpl; split; try discriminate.
  - intros (o & I). apply P in I. destruct I.
  - intros _. exists o. apply P; simpl; auto.
  - auto.
Qed.

Lemma earlier_filter : forall A (f : A -> bool) l c d,
  Earlier (filter f l) c d <-> Earlier l c d /\ f c = true /\ f d = true.
Proof.
  induction l as [| x l IH]; simpl; intros c d.
  - split; [intros H; inversion H | intros [H _]; inversion H].
  - destruct (f x) eqn:Q; split.
    + intros H; inversion H as [? ? ? I | ? ? ? ? I]; subst.
      * apply filter_In in I as [I J]. repeat split; auto. now constructor.
      * apply IH in I as (I & J & K). repeat split; auto. now apply earlier_there.
    + intros (H & C & D); inversion H as [? ? ? I | ? ? ? ? I]; subst.
      * constructor. apply filter_In; auto.
      * apply earlier_there, IH; auto.
    + intros H. apply IH in H as (H & C & D). repeat split; auto. now apply earlier_there.
    + intros (H & C & D); inversion H as [? ? ? I | ? ? ? ? I]; subst; [congruence |]. apply IH; auto.
Qed.

Lemma end_pairs_iff : forall last p o, In (p, o) (end_pairs t r last) <->
  exists n kept, In (n, kept) r /\ gate_of (node_at t n) = Pand /\
   ((exists c, In c kept /\ InPart t r c p /\ p <> last n c /\ o = last n c) \/
    (exists c d, Earlier kept c d /\ (exists x, InPart t r c x) /\ (exists x, InPart t r d x) /\ p = last n c /\
      o = last n d)).
Proof.
  intros last p o; unfold end_pairs. rewrite in_flat_map. assert (P := parts_iff t r W R). split.
  - intros ([n kept] & I & H). apply slots_iff in I as (all & I & G & ->). exists n, all; repeat split; auto.
    apply in_app_iff in H as [H | H].
    + left. apply in_flat_map in H as (c & J & H). apply filter_In in J as [J F].
      apply in_map_iff in H as (x & Q & H). injection Q; intros; subst. apply filter_In in H as [H N].
      exists c. split; [auto | split; [now apply P | split; [| auto]]].
      intros E. rewrite E, same_refl in N; discriminate.
    + right. apply in_map_iff in H as ([c d] & Q & H). injection Q; intros; subst.
      apply in_turn_iff, earlier_filter in H.
      destruct H as (H & C & D). exists c, d. rewrite <- !part_filled. auto.
  - intros (n & kept & I & G & H). exists (n, filter (fun c => negb (is_nil (parts t r c))) kept).
    split; [apply slots_iff; eauto |]. apply in_app_iff.
    destruct H as [(c & J & K & N & ->) | (c & d & E & C & D & -> & ->)].
    + left. apply in_flat_map. exists c; split; [apply filter_In; split; auto; apply part_filled; eauto |].
      apply in_map_iff. exists p; split; auto. apply filter_In; split; [now apply P |].
      apply negb_true_iff. now apply same_false.
    + right. apply in_map_iff. exists (c, d); split; auto. apply in_turn_iff, earlier_filter.
      rewrite !part_filled. auto.
Qed.

Theorem precedes_iff : forall last p o, Occurs t r p -> Occurs t r o ->
  (precedes (node_pairs t r) (end_pairs t r last) p o = true <-> Precedes t r last p o).
Proof.
  intros last p o Op Oo. unfold precedes. rewrite !orb_true_iff, andb_true_iff, Nat.eqb_eq, Nat.ltb_lt.
  assert (N : existsb (fun x => (fst x =? fst p) && (snd x =? fst o)) (node_pairs t r) = true <->
              In (fst p, fst o) (node_pairs t r)).
  { rewrite existsb_exists. split.
    - intros ([a b] & I & Q). simpl in Q. apply andb_true_iff in Q as [A B]. apply Nat.eqb_eq in A, B; subst; auto.
    - intros I; exists (fst p, fst o); split; auto. simpl; now rewrite !Nat.eqb_refl. }
  assert (Z : existsb (fun x => same (fst x) p && same (snd x) o) (end_pairs t r last) = true <->
              In (p, o) (end_pairs t r last)).
  { rewrite existsb_exists. split.
    - intros ([a b] & I & Q). simpl in Q. apply andb_true_iff in Q as [A B]. apply same_iff in A, B; subst; auto.
    - intros I; exists (p, o); split; auto. simpl; now rewrite !same_refl. }
  rewrite N, Z, node_pairs_iff, end_pairs_iff.
  destruct p as [n i], o as [m j]; simpl in *. split.
  - intros [[[-> L] | (k & kept & I & H)] | (k & kept & I & G & H)].
    + now constructor.
    + destruct H as [(T & -> & D & H) | [(T & -> & D & H) | [(G & c & d & E & H & K) | (G & c & d & E & H & K)]]].
      * apply cause_first; auto.
      * apply cause_last; auto.
      * eapply in_sequence; eauto; split; auto.
      * eapply in_reverse; eauto; split; auto.
    + destruct H as [(c & J & K & D & Q) | (c & d & E & (x & C) & (y & D) & Q & S)].
      * rewrite Q. eapply at_the_end; eauto.
      * rewrite Q, S. eapply ends_in_order; eauto.
  - assert (KEPT : forall k, In k (map fst r) -> exists kept, In (k, kept) r).
    { intros k I. apply in_map_iff in I as ([k' kept] & Q & I). simpl in Q; subst. eauto. }
    intros H; remember (n, i) as p; remember (m, j) as o; destruct H; subst.
    + injection Heqp; injection Heqo; intros; subst. left; left; auto.
    + injection Heqp; injection Heqo; intros; subst. left; right.
      destruct (KEPT n) as [kept K]; [apply Op |]. exists n, kept; split; auto.
    + injection Heqp; injection Heqo; intros; subst. left; right.
      destruct (KEPT m) as [kept K]; [apply Oo |]. exists m, kept; split; auto 6.
    + left; right. exists n0, kept; split; auto. right; right; left; split; auto.
      exists c, d; split; auto. destruct H2, H3; auto.
    + left; right. exists n0, kept; split; auto. right; right; right; split; auto.
      exists c, d; split; auto. destruct H2, H3; auto.
    + right. exists n0, kept; split; auto. split; auto. left; exists c; auto.
    + right. exists n0, kept; split; auto. split; auto. right; exists c, d; eauto 8.
Qed.

Lemma last_in_slots : forall chosen, In chosen (lasts t r) -> Lasts t r (last_in chosen).
Proof.
  intros chosen I n kept c o K G C P. unfold lasts in I. apply product_iff in I.
  assert (S : In (n, filter (fun c => negb (is_nil (parts t r c))) kept) (slots t r)) by (apply slots_iff; eauto).
  assert (F : In c (filter (fun c => negb (is_nil (parts t r c))) kept)) by (apply filter_In; split; auto;
    apply part_filled; eauto).
  set (options := flat_map _ (slots t r)) in I.
  assert (J : In (map (fun o => (n, c, o)) (parts t r c)) options).
  { apply in_flat_map. eexists; split; [exact S |]. apply in_map_iff. exists c; auto. }
  assert (ALL : forall x, In x chosen -> In (snd x) (parts t r (snd (fst x)))).
  { assert (O : forall l, In l options -> forall x, In x l -> In (snd x) (parts t r (snd (fst x)))).
    { intros l L x X. apply in_flat_map in L as ([k ks] & _ & L). apply in_map_iff in L as (d & <- & L).
      apply in_map_iff in X as (y & <- & X). auto. }
    clear - I O. induction I as [| y l chosen options Y I IH]; intros x X; [destruct X |].
    destruct X as [<- | X]; [apply (O l); simpl; auto | apply IH; auto; intros; apply (O l0); simpl; auto]. }
  assert (SOME : exists x, In x chosen /\ fst (fst x) = n /\ snd (fst x) = c).
  { clear - I J. induction I as [| y l chosen options Y I IH]; [destruct J |]. destruct J as [-> | J].
    - apply in_map_iff in Y as (o & <- & Y). exists (n, c, o); simpl; auto.
    - destruct (IH J) as (x & X & Q). exists x; simpl; auto. }
  unfold last_in. destruct (find _ chosen) as [x |] eqn:X.
  - apply find_some in X as [X Q]. apply andb_true_iff in Q as [Q1 Q2]. apply Nat.eqb_eq in Q2.
    apply ALL in X. rewrite Q2 in X. now apply (parts_iff t r W R).
  - destruct SOME as (x & X' & Q1 & Q2). apply (find_none _ _ X) in X'. rewrite Q1, Q2, !Nat.eqb_refl in X'.
    discriminate.
Qed.

Lemma lasts_cover : forall last, Lasts t r last -> exists chosen, In chosen (lasts t r) /\
  forall n kept c o, In (n, kept) r -> gate_of (node_at t n) = Pand -> In c kept -> InPart t r c o ->
    last_in chosen n c = last n c.
Proof.
  intros last L.
  set (all := flat_map (fun slot => map (fun c => (fst slot, c)) (snd slot)) (slots t r)).
  assert (A : forall n c, In (n, c) all <-> exists kept, In (n, kept) r /\ gate_of (node_at t n) = Pand /\
    In c kept /\ exists o, InPart t r c o).
  { intros n c. unfold all. rewrite in_flat_map. split.
    - intros ([k ks] & I & J). apply in_map_iff in J as (d & Q & J). injection Q; intros; subst. simpl in *.
      apply slots_iff in I as (kept & I & G & ->). apply filter_In in J as [J F]. apply part_filled in F.
      exists kept; auto.
    - intros (kept & I & G & J & F). exists (n, filter (fun c => negb (is_nil (parts t r c))) kept).
      split; [apply slots_iff; eauto |]. apply in_map_iff. exists c; split; auto. apply filter_In; split; auto.
      now apply part_filled. }
  exists (map (fun y => (fst y, snd y, last (fst y) (snd y))) all). split.
  - unfold lasts. apply product_iff.
    assert (V : forall slot c, In slot (slots t r) -> In c (snd slot) -> In (last (fst slot) c) (parts t r c)).
    { intros [n ks] c I J. simpl in *. apply (parts_iff t r W R). apply slots_iff in I as (kept & I & G & ->).
      apply filter_In in J as [J F]. apply part_filled in F as [o F]. eapply L; eauto. }
    unfold all. clear - V. induction (slots t r) as [| [n ks] l IH]; simpl; [constructor |].
    rewrite map_app. apply Forall2_app; [| apply IH; intros; apply V; simpl; auto].
    assert (V' : forall c, In c ks -> In (last n c) (parts t r c)) by (intros; apply (V (n, ks)); simpl; auto).
    clear - V'. induction ks as [| c ks IH]; simpl; constructor; [| apply IH; intros; apply V'; simpl; auto].
    apply in_map_iff. exists (last n c); split; auto. apply V'; simpl; auto.
  - intros n kept c o I G J P. unfold last_in. destruct (find _ _) as [x |] eqn:X.
    + apply find_some in X as [X Q]. apply in_map_iff in X as ([a b] & <- & X). simpl in *.
      apply andb_true_iff in Q as [Q1 Q2]. apply Nat.eqb_eq in Q1, Q2; subst; auto.
    + exfalso. assert (In (n, c) all) by (apply A; exists kept; eauto 6).
      apply (in_map (fun y => (fst y, snd y, last (fst y) (snd y)))) in H. apply (find_none _ _ X) in H. simpl in H.
      now rewrite !Nat.eqb_refl in H.
Qed.

Lemma precedes_lasts : forall last last',
  (forall n kept c o, In (n, kept) r -> gate_of (node_at t n) = Pand -> In c kept -> InPart t r c o ->
    last n c = last' n c) ->
  forall p o, Precedes t r last p o -> Precedes t r last' p o.
Proof.
  intros last last' S p o H; destruct H.
  - now constructor.
  - now apply cause_first.
  - now apply cause_last.
  - eapply in_sequence; eauto.
  - eapply in_reverse; eauto.
  - rewrite (S n kept c o) in * by auto. eapply at_the_end; eauto.
  - destruct (earlier_in _ _ _ _ H1) as [C D].
    rewrite (S n kept c p), (S n kept d o) by auto. eapply ends_in_order; eauto.
Qed.
End Precedence.

(** ** Feasible scenarios *)

(** What remains of a list of occurrences when those without predecessor are dropped [n] times. *)
Fixpoint drop_first (n : nat) (before : occurrence -> occurrence -> bool) (l : list occurrence) : list occurrence :=
  match n with
  | 0 => l
  | S n => match filter (fun o => existsb (fun p => before p o) l) l with [] => [] |
    rest => drop_first n before rest end
  end.

Definition acyclic before (os : list occurrence) : bool := is_nil (drop_first (length os) before os).

Lemma drop_first_step : forall n before l,
  drop_first (S n) before l = drop_first n before (filter (fun o => existsb (fun p => before p o) l) l).
Proof.
  intros; simpl. destruct (filter _ l) eqn:F; auto. destruct n; auto.
Qed.

Lemma filter_shorter : forall A (f : A -> bool) l x, In x l -> f x = false -> length (filter f l) < length l.
Proof.
  induction l as [| y l IH]; simpl; intros x I F; [destruct I |].
  assert (G : length (filter f l) <= length l) by (clear; induction l; simpl; auto; destruct (f a); simpl; lia).
  destruct I as [-> | I]; [rewrite F; lia |]. specialize (IH x I F). destruct (f y); simpl; lia.
Qed.

Lemma least_by : forall (rank : occurrence -> nat) l, l <> [] -> exists x, In x l /\ forall y, In y l ->
  rank x <= rank y.
Proof.
  induction l as [| x l IH]; intros N; [congruence |]. destruct l as [| z l].
  - exists x; split; simpl; auto. intros y [<- | []]; auto.
  - destruct IH as (y & I & L); [congruence |]. destruct (le_lt_dec (rank x) (rank y)).
    + exists x; split; simpl; auto. intros w [<- | J]; auto. apply L in J; lia.
    + exists y; split; simpl; auto. intros w [<- | J]; [lia | auto].
Qed.

Lemma acyclic_iff : forall before os, acyclic before os = true <->
  exists rank : occurrence -> nat, forall p o, In p os -> In o os -> before p o = true -> rank p < rank o.
Proof.
  intros before os; unfold acyclic. split.
  - generalize (length os) as n. intros n H.
    assert (D : drop_first n before os = []) by (destruct (drop_first n before os); [auto | discriminate]).
    clear H. revert os D.
    induction n as [| n IH]; intros os D; [simpl in D; subst; exists (fun _ => 0); intros ? ? [] |].
    rewrite drop_first_step in D.
    destruct (IH _ D) as [rank R]. set (os' := filter (fun o => existsb (fun p => before p o) os) os) in *.
    exists (fun o => if among o os' then S (rank o) else 0). intros p o I J B.
    assert (O : In o os') by (apply filter_In; split; auto; apply existsb_exists; eauto).
    rewrite (proj2 (among_iff o os') O). destruct (among p os') eqn:P; [| lia].
    apply among_iff in P. assert (rank p < rank o) by auto. lia.
  - intros [rank R]. assert (D : forall n l, length l <= n -> incl l os -> drop_first n before l = []).
    { induction n as [| n IH]; intros l L I; [destruct l; simpl in *; auto; lia |].
      rewrite drop_first_step. apply IH; [| intros x X; apply filter_In in X; apply I; tauto].
      destruct l as [| z l]; [simpl; lia |].
      destruct (least_by rank (z :: l)) as (m & A & B); [congruence |].
      assert (F : existsb (fun p => before p m) (z :: l) = false).
      { apply not_true_is_false; intros F. apply existsb_exists in F as (p & X & Y).
        assert (rank p < rank m) by (apply R; auto). apply B in X. lia. }
      assert (K := filter_shorter _ (fun o => existsb (fun p => before p o) (z :: l)) (z :: l) m A F). lia. }
    rewrite D; auto. apply incl_refl.
Qed.

Definition is_constant (g : guard) : bool := is_nil (variables g) && is_nil (points g).

Definition guards_of (t : tree) (r : resolution) : list guard := flat_map (guards_at t) (map fst r).

Lemma guards_of_iff : forall t r g, In g (guards_of t r) <-> exists n, In n (map fst r) /\ In g (guards_at t n).
Proof. intros; unfold guards_of. rewrite in_flat_map. reflexivity. Qed.

Definition constants_hold (guards : list guard) : bool :=
  forallb (holds (fun _ => Null) (fun _ => None)) (filter is_constant guards).

Lemma constants_hold_iff : forall t r, constants_hold (guards_of t r) = true <->
  forall n g, In n (map fst r) -> In g (conditions t n) -> variables g = [] -> points g = [] ->
    holds (fun _ => Null) (fun _ => None) g = true.
Proof.
  intros t r; unfold constants_hold. rewrite forallb_forall. split.
  - intros H n g I J V P. replace g with (rename_guard (rename t (n, 0)) g)
      by (apply rename_guard_same; rewrite V; intros ? []).
    apply H, filter_In. split.
    + apply guards_of_iff. exists n; split; auto. apply in_guards_at. left. exists 0, g. repeat split; auto. lia.
    + unfold is_constant. now rewrite renamed_variables, renamed_points, V, P.
  - intros H g I. apply filter_In in I as [I C]. apply guards_of_iff in I as (n & I & J).
    apply andb_true_iff in C as [V P]. apply is_nil_iff in V, P.
    apply in_guards_at in J as [(i & g' & _ & J & ->) | (i & j & _ & D & ->)].
    + rewrite renamed_variables in V. rewrite renamed_points in P. apply map_eq_nil in V.
      rewrite rename_guard_same by (rewrite V; intros ? []). eapply H; eauto.
    + exfalso. destruct (distinct_values (node_at t n)) as [| x l]; [congruence | discriminate V].
Qed.

(** ** Selections *)

Fixpoint equal_numbers (l m : list nat) : bool :=
  match l, m with
  | [], [] => true
  | a :: l, b :: m => (a =? b) && equal_numbers l m
  | _, _ => false
  end.

Lemma equal_numbers_iff : forall l m, equal_numbers l m = true <-> l = m.
Proof.
  induction l as [| a l IH]; destruct m as [| b m]; simpl; try (split; congruence).
  rewrite andb_true_iff, Nat.eqb_eq, IH. split; [intros [-> ->]; auto | intros H; injection H; auto].
Qed.

Definition in_branch (t : tree) (b r : resolution) : bool :=
  forallb (fun x => match gate_of (node_at t (fst x)) with
                    | Or => existsb (fun y => (fst x =? fst y) && equal_numbers (snd x) (snd y)) b
                    | _ => true
                    end) r.

Lemma in_branch_iff : forall t b r, in_branch t b r = true <-> InBranch t b r.
Proof.
  intros t b r; unfold in_branch, InBranch. rewrite forallb_forall. split.
  - intros H n kept I G. specialize (H _ I). simpl in H. rewrite G in H. apply existsb_exists in H as ([m k] & J & Q).
    simpl in Q. apply andb_true_iff in Q as [Q1 Q2]. apply Nat.eqb_eq in Q1. apply equal_numbers_iff in Q2. subst; auto.
  - intros H [n kept] I. simpl. destruct (gate_of (node_at t n)) eqn:G; auto.
    apply existsb_exists. exists (n, kept); split; auto. simpl.
    now rewrite Nat.eqb_refl, (proj2 (equal_numbers_iff _ _) eq_refl).
Qed.

Definition same_kind (a b : kind) : bool :=
  match a, b with Fault, Fault | Attack, Attack => true | _, _ => false end.

Definition has_kind (t : tree) (k : kind) (b : resolution) : bool :=
  existsb (fun n => match kind_of (node_at t n) with Some k' => same_kind k k' | None => false end) (map fst b).

Lemma has_kind_iff : forall t k b, has_kind t k b = true <-> exists n, In n (map fst b) /\
  kind_of (node_at t n) = Some k.
Proof.
  intros t k b; unfold has_kind. rewrite existsb_exists. split; intros (n & I & K); exists n; split; auto.
  - destruct (kind_of (node_at t n)) as [k' |]; [| discriminate]. destruct k, k'; try discriminate; auto.
  - rewrite K. destruct k; auto.
Qed.

(** The test whether a resolution belongs to a selection; the branches are computed once. *)
Definition selected (t : tree) (w : selection) : resolution -> bool :=
  match w with
  | Everything => fun _ => true
  | OneBranch b => in_branch t b
  | OfKind k => let some := filter (has_kind t k) (branches t) in fun r => existsb (fun b => in_branch t b r) some
  end.

Lemma selected_iff : forall t w r, WellFormed t -> (selected t w r = true <-> Selected t w r).
Proof.
  intros t [| b | k] r W; simpl.
  - tauto.
  - apply in_branch_iff.
  - rewrite existsb_exists. split.
    + intros (b & I & J). apply filter_In in I as [I K]. exists b. apply branches_iff in I; auto.
      apply in_branch_iff in J. apply has_kind_iff in K. auto.
    + intros (b & B & J & K).
      exists b; split; [apply filter_In; split;
        [now apply branches_iff | now apply has_kind_iff] | now apply in_branch_iff].
Qed.

(** ** Plans *)

(** What [make] makes of each feasible scenario of a resolution: of its guards, the parts of its nodes,
    its occurrences and their precedence. *)
Definition each_scenario {A} (make : list guard -> (nat -> list occurrence) -> list occurrence ->
  (occurrence -> occurrence -> bool) -> A) (t : tree) (r : resolution) : list A :=
  let os := occurrences_of t r in
  let ordered := node_pairs t r in
  let guards := guards_of t r in
  let part := parts t r in
  if constants_hold guards
  then flat_map (fun chosen =>
         let before := precedes ordered (end_pairs t r (last_in chosen)) in
         if acyclic before os then [make guards part os before] else []) (lasts t r)
  else [].

Definition selected_scenarios {A} make (t : tree) (w : selection) : list A :=
  let keep := selected t w in flat_map (each_scenario make t) (filter keep (resolutions t)).

Lemma in_each_scenario : forall A (make : resolution -> _ -> _ -> _ -> _ -> A) t w c,
  In c (flat_map (fun r => each_scenario (make r) t r) (filter (selected t w) (resolutions t))) <->
  exists r chosen, In r (resolutions t) /\ selected t w r = true /\ constants_hold (guards_of t r) = true /\
    In chosen (lasts t r) /\
    let before := precedes (node_pairs t r) (end_pairs t r (last_in chosen)) in
    acyclic before (occurrences_of t r) = true /\
    c = make r (guards_of t r) (parts t r) (occurrences_of t r) before.
Proof.
  intros A make t w c. rewrite in_flat_map. split.
  - intros (r & I & J). apply filter_In in I as [I K]. unfold each_scenario in J.
    destruct (constants_hold (guards_of t r)) eqn:C; [| destruct J].
    apply in_flat_map in J as (chosen & J & L). cbv zeta in L.
    destruct (acyclic _ _) eqn:Y in L; [| destruct L]. destruct L as [<- | []].
    exists r, chosen. repeat split; auto.
  - intros (r & chosen & I & K & C & J & Y & ->). exists r; split; [apply filter_In; auto |].
    unfold each_scenario. rewrite C. apply in_flat_map. exists chosen; split; auto. cbv zeta. rewrite Y. simpl; auto.
Qed.

Lemma in_scenarios : forall A (make : _ -> _ -> _ -> _ -> A) t w c, In c (selected_scenarios make t w) <->
  exists r chosen, In r (resolutions t) /\ selected t w r = true /\ constants_hold (guards_of t r) = true /\
    In chosen (lasts t r) /\
    let before := precedes (node_pairs t r) (end_pairs t r (last_in chosen)) in
    acyclic before (occurrences_of t r) = true /\
    c = make (guards_of t r) (parts t r) (occurrences_of t r) before.
Proof. intros A make t w c. exact (in_each_scenario A (fun _ => make) t w c). Qed.

Lemma map_scenarios : forall A B (f : A -> B) make t w,
  map f (selected_scenarios make t w) = selected_scenarios (fun g p os before => f (make g p os before)) t w.
Proof.
  intros A B f make t w. unfold selected_scenarios. cbv zeta. generalize (filter (selected t w) (resolutions t)) as l.
  induction l as [| r l IH]; simpl; auto. rewrite map_app, IH. f_equal. unfold each_scenario.
  destruct (constants_hold (guards_of t r)); auto.
  induction (lasts t r) as [| chosen m IHm]; simpl; auto. rewrite map_app, IHm. f_equal.
  destruct (acyclic _ _); auto.
Qed.

Definition plans (t : tree) (w : selection) : list (plan event) :=
  selected_scenarios (fun guards part os before => Plan os before (consistent t guards part)) t w.

Lemma in_plans : forall t w c, In c (plans t w) <->
  exists r chosen, In r (resolutions t) /\ selected t w r = true /\ constants_hold (guards_of t r) = true /\
    In chosen (lasts t r) /\
    let before := precedes (node_pairs t r) (end_pairs t r (last_in chosen)) in
    acyclic before (occurrences_of t r) = true /\
    c = Plan (occurrences_of t r) before (consistent t (guards_of t r) (parts t r)).
Proof. intros t w c. unfold plans. apply in_scenarios. Qed.

Theorem plans_lawful : forall t w, WellFormed t -> Forall lawful (plans t w).
Proof.
  intros t w W. apply Forall_forall. intros c I. apply in_plans in I as (r & chosen & I & _ & _ & _ & _ & ->).
  apply resolutions_iff in I; auto.
  apply (consistent_lawful t (guards_of t r) (parts t r) r). now apply parts_iff.
Qed.

(** What [plans] says of the scenario that a plan denotes. *)
Lemma plan_facts : forall t w r chosen, WellFormed t -> In r (resolutions t) -> selected t w r = true ->
  constants_hold (guards_of t r) = true -> In chosen (lasts t r) ->
  let before := precedes (node_pairs t r) (end_pairs t r (last_in chosen)) in
  acyclic before (occurrences_of t r) = true ->
  Resolution t r /\ Selected t w r /\ Lasts t r (last_in chosen) /\ Feasible t r (last_in chosen) /\
  (forall p o, Occurs t r p -> Occurs t r o -> (before p o = true <-> Precedes t r (last_in chosen) p o)) /\
  (forall m, NoDup (domain m) -> incl (domain m) (occurrences_of t r) ->
     (consistent t (guards_of t r) (parts t r) m = true <-> Consistent t r m)).
Proof.
  intros t w r chosen W I K C J before A. apply resolutions_iff in I; auto.
  split; [auto |]. split; [now apply selected_iff |]. split; [now apply last_in_slots |].
  split; [split | split].
  - apply acyclic_iff in A as [rank A]. exists rank. intros p o P O H.
    apply A; [now apply occurrences_iff | now apply occurrences_iff |]. now apply precedes_iff.
  - now apply constants_hold_iff.
  - intros p o P O. now apply precedes_iff.
  - intros m N IN. apply consistent_iff; auto; [now apply parts_iff | intros; apply guards_of_iff |].
    intros o P. apply IN, occurrences_iff in P. apply P.
Qed.

(** The plan of a scenario. *)
Lemma scenario_plan : forall t w past c, WellFormed t -> IsScenario t w past c ->
  exists r chosen, In r (resolutions t) /\ selected t w r = true /\ constants_hold (guards_of t r) = true /\
    In chosen (lasts t r) /\
    let before := precedes (node_pairs t r) (end_pairs t r (last_in chosen)) in
    acyclic before (occurrences_of t r) = true /\
    (forall o, In o (occurrences c) <-> In o (occurrences_of t r)) /\
    (forall p o, In p (occurrences c) -> In o (occurrences c) ->
      (RVAFT.Definition.before c p o <-> before p o = true)) /\
    (forall m, NoDup (domain m) -> incl (domain m) (occurrences c) ->
       (RVAFT.Definition.consistent c m <-> consistent t (guards_of t r) (parts t r) m = true)) /\
    (forall trace position m, NoDup (domain m) -> incl (domain m) (occurrences c) ->
      RVAFT.Definition.consistent c m ->
       let at_position := fun o => length past + position o in
       (unbroken c trace position m <-> Unbroken t r (past ++ trace) at_position m) /\
       (decided c trace position m <-> Decided t r (past ++ trace) at_position m)).
Proof.
  intros t w past c W (r & last & R & S & L & [[rank F] C] & O & B & M & U).
  destruct (lasts_cover t r W R last L) as (chosen & J & Q). exists r, chosen.
  assert (PRE : forall p o, Precedes t r (last_in chosen) p o <-> Precedes t r last p o).
  { intros p o; split; apply precedes_lasts; auto. intros; symmetry; eauto. }
  split; [now apply resolutions_iff |]. split; [now apply selected_iff |]. split; [now apply constants_hold_iff |].
  split; [auto |]. split; [| split; [| split; [| split]]]; auto.
  - apply acyclic_iff. exists rank. intros p o P P' H. apply occurrences_iff in P, P'.
    apply F; auto. apply PRE. now apply precedes_iff in H.
  - intros o. now rewrite O, occurrences_iff.
  - intros p o P P'. apply O in P, P'. rewrite B, <- PRE by auto. symmetry; now apply precedes_iff.
  - intros m N IN. rewrite M by auto. symmetry.
    apply consistent_iff; auto; [now apply parts_iff | intros; apply guards_of_iff |].
    intros o P. apply IN, O in P. apply P.
Qed.

(** Without absent events nothing breaks a match, and no match waits. *)
Lemma nothing_breaks : forall t r trace position m, no_absences t = true -> Consistent t r m ->
  Unbroken t r trace position m /\ Decided t r trace position m.
Proof.
  intros t r trace position m N (a & own & H). assert (W := nothing_absent t N). split.
  - exists a, own. split; auto. intros n c _ I. rewrite W in I. destruct I.
  - intros n c d _ I. rewrite W in I. destruct I.
Qed.

(** The other positions of a trace do not matter. *)
Definition Quiet {E} (c : scenario E) : Prop := forall trace position m, NoDup (domain m) ->
  incl (domain m) (occurrences c) -> RVAFT.Definition.consistent c m ->
  unbroken c trace position m /\ decided c trace position m.

Lemma scenario_quiet : forall t w past c, no_absences t = true -> IsScenario t w past c -> Quiet c.
Proof.
  intros t w past c N (r & last & _ & _ & _ & _ & _ & _ & M & U) trace position m ND IN H.
  destruct (U trace position m ND IN H) as [-> ->]. apply M in H; auto. now apply nothing_breaks.
Qed.

Lemma denoted_quiet : forall E (c : plan E), Quiet (denoted c).
Proof. intros E c trace position m _ _ _. split; exact I. Qed.

Lemma quiet_match : forall E (Rel : E -> Prop) s (c : scenario E) u, Quiet c ->
  (Match Rel s c u <-> exists position m, Partial c u position m /\ complete c m /\
     match_positions Rel s u (Used position m)).
Proof.
  intros E Rel s c u Q. split; [intros (pos & m & P & C & M & _); exists pos, m; auto |].
  intros (pos & m & P & C & M). exists pos, m. split; [auto | split; [auto | split; [auto |]]].
  apply Q; apply P.
Qed.

Lemma quiet_left : forall E (Rel : E -> Prop) s (c : scenario E) u, Quiet c ->
  (PartialMatch Rel s c u <-> exists position m, Partial c u position m /\ ~ complete c m /\
     partial_positions Rel s u (Used position m)).
Proof.
  intros E Rel s c u Q. split.
  - intros (pos & m & P & _ & [[C M] | (_ & _ & D)]); [exists pos, m; auto |]. exfalso. apply D, Q; apply P.
  - intros (pos & m & P & C & M). exists pos, m. split; [auto | split; [apply Q; apply P | auto]].
Qed.

Theorem plans_sound : forall t w past c, WellFormed t -> no_absences t = true -> In c (plans t w) ->
  IsScenario t w past (denoted c).
Proof.
  intros t w past c W N I. apply in_plans in I as (r & chosen & I & K & C & J & A & ->).
  destruct (plan_facts t w r chosen W I K C J A) as (R & S & L & F & P & CO).
  exists r, (last_in chosen). repeat (split; [assumption |]). simpl.
  split; [intros o; apply occurrences_iff | split; [auto | split; [auto |]]].
  intros trace position m ND IN H. apply CO in H; auto.
  destruct (nothing_breaks t r (past ++ trace) (fun o => length past + position o) m N H); tauto.
Qed.

(** Two descriptions of one scenario. *)
Record Alike {E} (c d : scenario E) : Prop := {
  alike_occurrences : forall o, In o (occurrences c) <-> In o (occurrences d);
  alike_before : forall p o, In p (occurrences c) -> In o (occurrences c) -> (before c p o <-> before d p o);
  alike_consistent : forall m, NoDup (domain m) -> incl (domain m) (occurrences c) ->
    (RVAFT.Definition.consistent c m <-> RVAFT.Definition.consistent d m);
  alike_unbroken : forall trace position m, NoDup (domain m) -> incl (domain m) (occurrences c) ->
    RVAFT.Definition.consistent c m ->
    (unbroken c trace position m <-> unbroken d trace position m) /\
    (decided c trace position m <-> decided d trace position m) }.

Theorem plans_complete : forall t w past c, WellFormed t -> no_absences t = true -> IsScenario t w past c ->
  exists d, In d (plans t w) /\ Alike c (denoted d).
Proof.
  intros t w past c W N H.
    destruct (scenario_plan t w past c W H) as (r & chosen & I & S & C & L & A & O & B & M & U).
  exists (Plan (occurrences_of t r) (precedes (node_pairs t r) (end_pairs t r (last_in chosen)))
            (consistent t (guards_of t r) (parts t r))).
  split; [apply in_plans; exists r, chosen; auto 7 |]. constructor; simpl; auto.
  intros trace position m ND IN K. destruct (U trace position m ND IN K) as [-> ->].
  assert (CO : Consistent t r m).
  { destruct (plan_facts t w r chosen W I S C L A) as (_ & _ & _ & _ & _ & CO). apply CO; auto; [| now apply M].
    intros o P. now apply O, IN. }
  destruct (nothing_breaks t r (past ++ trace) (fun o => length past + position o) m N CO); tauto.
Qed.
