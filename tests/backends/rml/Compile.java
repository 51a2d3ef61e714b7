// Compiles many RML files with the published compiler in one process: java -cp COMPILER.jar Compile.java < pairs
// A pair is one line, INPUT<TAB>OUTPUT. For each one line comes out: "ok", or "refused: " and the first line of the complaint;
// whatever the compiler says on its standard error counts as a complaint, as it may have repaired the text.
import java.io.*;
import java.nio.charset.StandardCharsets;
import java.util.Scanner;

public class Compile {
    public static void main(String[] arguments) throws IOException {
        PrintStream error = System.err;
        Scanner pairs = new Scanner(System.in, StandardCharsets.UTF_8);
        while (pairs.hasNextLine()) {
            String[] pair = pairs.nextLine().split("\t");
            ByteArrayOutputStream complaints = new ByteArrayOutputStream();
            System.setErr(new PrintStream(complaints, true, StandardCharsets.UTF_8));
            try (InputStream in = new FileInputStream(pair[0]); OutputStream out = new FileOutputStream(pair[1])) {
                compiler.MainKt.compile(in, out);
            } catch (Throwable thrown) {
                System.err.println(thrown);
            }
            System.setErr(error);
            String[] lines = complaints.toString(StandardCharsets.UTF_8).split("\n");
            System.out.println(lines[0].isEmpty() ? "ok" : "refused: " + lines[0]);
        }
    }
}
