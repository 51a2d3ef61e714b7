(** * Equality by value is equality of normal forms

    The definition compares numbers by their mathematical value, and objects by their fields in any
    order.  The values of [Values.v] are normal forms: for these both are equality. *)

Require Import List Bool Arith ZArith Lia Sorted.
Require Import RVAFT.Values RVAFT.Language.
Import ListNotations.
Local Open Scope Z_scope.

(** ** Numbers *)

Definition NormalNumber (a : number) : Prop := scale a = 0%N \/ Z.odd (mantissa a) = true.

Lemma even_multiple : forall m s, (0 < s)%N -> Z.odd (m * 2 ^ Z.of_N s) = false.
Proof.
  intros m s L. rewrite Z.odd_mul, Z.odd_pow by lia. simpl. now rewrite andb_false_r.
Qed.

(** Two normal numbers have the same value only if they are equal. *)
Theorem same_number_iff : forall a b, NormalNumber a -> NormalNumber b -> (compare_numbers a b = Eq <-> a = b).
Proof.
  intros [m s] [n r] A B. unfold compare_numbers, NormalNumber in *. simpl in *. rewrite Z.compare_eq_iff. split.
  - intros E.
    assert (CANCEL : forall m n s d, m * 2 ^ Z.of_N (s + d) = n * 2 ^ Z.of_N s -> n = m * 2 ^ Z.of_N d).
    { intros m0 n0 s0 d0 Q. rewrite N2Z.inj_add, Z.pow_add_r in Q by lia.
      apply Z.mul_reg_r with (p := 2 ^ Z.of_N s0); [apply Z.pow_nonzero; lia |]. rewrite <- Q. ring. }
    destruct (N.lt_trichotomy s r) as [L | [-> | L]].
    + exfalso. assert (Q : n = m * 2 ^ Z.of_N (r - s)).
      { apply (CANCEL m n s (r - s)%N). replace (s + (r - s))%N with r by lia. exact E. }
      destruct B as [B | B]; [lia |]. rewrite Q, even_multiple in B by lia. discriminate.
    + f_equal. apply Z.mul_reg_r with (p := 2 ^ Z.of_N r); auto. apply Z.pow_nonzero; lia.
    + exfalso. assert (Q : m = n * 2 ^ Z.of_N (s - r)).
      { apply (CANCEL n m r (s - r)%N). replace (r + (s - r))%N with s by lia. symmetry; exact E. }
      destruct A as [A | A]; [lia |]. rewrite Q, even_multiple in A by lia. discriminate.
  - intros E; injection E as -> ->; auto.
Qed.

Lemma halve_normal : forall fuel m s, (s <= N.of_nat fuel)%N -> NormalNumber (halve fuel m s).
Proof.
  induction fuel as [| fuel IH]; intros m s L; cbn [halve].
  - left; simpl; lia.
  - destruct (N.eqb s 0) eqn:Q; [left; auto |]. apply N.eqb_neq in Q.
    destruct (Z.even m) eqn:E; [apply IH; lia |]. right. simpl. now rewrite <- Z.negb_even, E.
Qed.

(** [binary], which makes all doubles, gives normal numbers. *)
Theorem binary_normal : forall m e, NormalNumber (binary m e).
Proof.
  intros m e. unfold binary. destruct (Z.leb 0 e) eqn:L; [left; auto |].
  destruct (Z.eqb m 0); [left; auto |]. apply Z.leb_gt in L. apply halve_normal. lia.
Qed.

(** ** Objects *)

Definition before (a b : text * value) : Prop := compare_text (fst a) (fst b) = Lt.

Lemma compare_text_eq : forall s t, compare_text s t = Eq <-> s = t.
Proof.
  induction s as [| a s IH]; destruct t as [| b t]; simpl; try (split; congruence).
  destruct (Nat.compare_spec a b) as [-> | L | L].
  - rewrite IH. split; [intros ->; auto | intros H; injection H; auto].
  - split; [discriminate | intros H; injection H; intros; lia].
  - split; [discriminate | intros H; injection H; intros; lia].
Qed.

Lemma compare_text_swap : forall s t, compare_text s t = Gt -> compare_text t s = Lt.
Proof.
  induction s as [| a s IH]; destruct t as [| b t]; simpl; try discriminate; auto.
  rewrite (Nat.compare_antisym a b). destruct (Nat.compare a b); simpl; auto; discriminate.
Qed.

Lemma compare_text_trans : forall s t u, compare_text s t = Lt -> compare_text t u = Lt -> compare_text s u = Lt.
Proof.
  induction s as [| a s IH]; destruct t as [| b t], u as [| c u]; simpl; try discriminate; auto.
  destruct (Nat.compare_spec a b) as [-> | L | L]; destruct (Nat.compare_spec b c) as [-> | K | K]; try discriminate.
  - apply IH.
  - auto.
  - intros _ _. now rewrite (proj2 (Nat.compare_lt_iff a c) L).
  - intros _ _. now rewrite (proj2 (Nat.compare_lt_iff a c) (Nat.lt_trans _ _ _ L K)).
Qed.

Definition NormalFields (f : list (text * value)) : Prop := StronglySorted before f.

Lemma insert_field_in : forall name v f x, In x (insert_field name v f) -> x = (name, v) \/ In x f.
Proof.
  induction f as [| [a w] f IH]; simpl; intros x I.
  - destruct I as [<- | []]; auto.
  - destruct (compare_text name a); simpl in I.
    + destruct I as [<- | I]; auto.
    + destruct I as [<- | [<- | I]]; auto.
    + destruct I as [<- | I]; auto. apply IH in I as [-> | I]; auto.
Qed.

Lemma insert_field_normal : forall name v f, NormalFields f -> NormalFields (insert_field name v f).
Proof.
  induction f as [| [a w] f IH]; intros N; [repeat constructor |].
  inversion N as [| ? ? N' ALL]; subst. simpl. destruct (compare_text name a) eqn:C.
  - apply compare_text_eq in C; subst. constructor; auto.
  - constructor; auto. constructor; auto. rewrite Forall_forall in *. intros [b x] I. specialize (ALL _ I).
    unfold before in *; simpl in *. eapply compare_text_trans; eauto.
  - constructor; [now apply IH |]. rewrite Forall_forall in *. intros x I.
    apply insert_field_in in I as [-> | I]; auto. unfold before; simpl. now apply compare_text_swap.
Qed.

Theorem object_normal : forall f, exists g, object f = Object g /\ NormalFields g.
Proof.
  intros f. unfold object. eexists; split; [reflexivity |].
  assert (H : forall g, NormalFields g ->
    NormalFields (fold_left (fun made field => insert_field (fst field) (snd field) made) f g)).
  { induction f as [| [a v] f IH]; simpl; intros g N; auto. apply IH. now apply insert_field_normal. }
  apply H. constructor.
Qed.

Lemma field_later : forall name v f, Forall (before (name, v)) f -> field name f = None.
Proof.
  induction f as [| [a w] f IH]; intros ALL; auto. inversion ALL as [| ? ? B ALL']; subst. simpl.
  destruct (text_eqb name a) eqn:Q; auto. apply text_eqb_iff in Q; subst. unfold before in B; simpl in B.
  rewrite (proj2 (compare_text_eq a a) eq_refl) in B; discriminate.
Qed.

(** Normal objects with the same values of all fields are equal. *)
Theorem same_object_iff : forall f g, NormalFields f -> NormalFields g ->
  ((forall name, field name f = field name g) <-> f = g).
Proof.
  assert (SELF : forall s, text_eqb s s = true) by (intros; now apply text_eqb_iff).
  intros f g Nf Ng; split; [| intros ->; auto]. revert g Ng.
  induction f as [| [a v] f IH]; intros [| [b w] g] Ng S; auto.
  - specialize (S b). simpl in S. rewrite SELF in S. discriminate.
  - specialize (S a). simpl in S. rewrite SELF in S. discriminate.
  - inversion Nf as [| ? ? Nf' Af]; subst. inversion Ng as [| ? ? Ng' Ag]; subst.
    assert (E : a = b).
    { destruct (compare_text a b) eqn:C.
      - now apply compare_text_eq.
      - assert (H := S a). rewrite (field_later a v ((b, w) :: g)) in H; [simpl in H; rewrite SELF in H;
          discriminate |].
        constructor; auto. rewrite Forall_forall in *. intros x I. specialize (Ag x I). unfold before in *; simpl in *.
        eapply compare_text_trans; eauto.
      - apply compare_text_swap in C. assert (H := S b).
        rewrite (field_later b w ((a, v) :: f)) in H; [simpl in H; rewrite SELF in H; discriminate |].
        constructor; auto. rewrite Forall_forall in *. intros x I. specialize (Af x I). unfold before in *; simpl in *.
        eapply compare_text_trans; eauto. }
    subst b. assert (H := S a). simpl in H. rewrite SELF in H. injection H as ->. f_equal. apply IH; auto.
    intros name. specialize (S name). simpl in S. destruct (text_eqb name a) eqn:Q; auto.
    apply text_eqb_iff in Q; subst. now rewrite (field_later a w f Af), (field_later a w g Ag).
Qed.
